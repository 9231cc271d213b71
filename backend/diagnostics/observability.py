"""Observability: directions of motion constrained by the steps alone, and frames of too uncertain position."""

import numpy as np

from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.marginal_covariance import Uncertainty
from asfm.diagnostics import Diagnostic, FrameRuns, format_runs, frame_runs
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.types import BoolArray, FloatArray

SPAN = 10
"""Frames over which the uncertainty of motion is evaluated: the sonar's share in a single step is too small to see."""
UNOBSERVED_RATIO = 0.9
"""A direction is unobserved where its standard deviation is at least this fraction of that from the steps alone."""
MIN_RUN_FRAMES = 5
"""Shorter runs of frames are not reported."""
MAX_RELATIVE_SIGMA = 0.1
"""Largest standard deviation of the position, relative to the length of the path, that is not warned of."""
MIN_PATH_RANGES = 0.1
"""Lower bound of that path length, relative to the typical range: a sonar at rest has a path of length zero."""
DIRECTIONS = ("roll", "pitch", "yaw", "forward motion", "sideways motion", "height")
"""Names of the six directions, in the vehicle frame and in the order of the covariances."""


def warn_of_unreliable_poses(solution: Solution, uncertainty: Uncertainty) -> tuple[Diagnostic, ...]:
    """Report unobserved directions and too uncertain positions.

    Args:
        solution: N poses, their tracks and sensors.
        uncertainty: covariances of the solution, with spans of :data:`SPAN` frames or fewer.
    """
    used = solution.observed
    if not used.any():
        return ()
    range_m = float(np.median(solution.tracks.range_m[used]))
    of_position = warn_of_position_uncertainty(uncertainty, solution.bundle.world_from_vehicle, range_m)
    return (*warn_of_unobserved_directions(uncertainty, solution.problem.sensors), *of_position)


def warn_of_unobserved_directions(uncertainty: Uncertainty, sensors: SensorConstraints) -> tuple[Diagnostic, ...]:
    """Report the directions that only the odometry, or the motion prior, constrains, and in which frames.

    Args:
        uncertainty: with spans of :data:`SPAN` frames, or fewer in a shorter sequence.
        sensors: the steps with their sigmas.
    """
    unobserved = find_unobserved_directions(uncertainty, sensors)
    directions: dict[FrameRuns, list[str]] = {}
    for axis, name in enumerate(DIRECTIONS):
        runs = frame_runs(unobserved[:, axis], MIN_RUN_FRAMES)
        if runs:
            directions.setdefault(runs, []).append(name)
    constraint = "the odometry" if sensors.measured else "the assumption that the vehicle moves little"
    return tuple(
        Diagnostic(
            "unobserved-directions",
            f"{_join(names)} {'is' if len(names) == 1 else 'are'} held by {constraint} alone "
            f"in frames {format_runs(runs)}",
            runs,
        )
        for runs, names in directions.items()
    )


def find_unobserved_directions(uncertainty: Uncertainty, sensors: SensorConstraints) -> BoolArray:
    """Find the directions of motion that only the steps constrain.

    Args:
        uncertainty: of N poses and N - S spans of S frames.
        sensors: the (N - 1) steps with their sigmas.

    Returns:
        (N, 6) whether each direction is unobserved, in all frames of a span in which it is.
    """
    count, spans = len(uncertainty.pose), len(uncertainty.span)
    span = count - spans
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(sensors.step_sigma**2, axis=0)])
    from_steps = np.sqrt(total[span:] - total[:spans])  # of each span, from the steps alone
    sigma = np.sqrt(np.maximum(np.diagonal(uncertainty.span, axis1=1, axis2=2), 0))
    unobserved_spans = sigma >= UNOBSERVED_RATIO * np.repeat(from_steps, 3, axis=1)
    unobserved = np.zeros((count, 6), dtype=bool)
    for shift in range(span + 1):
        unobserved[shift : shift + spans] |= unobserved_spans
    return unobserved


def warn_of_position_uncertainty(
    uncertainty: Uncertainty, world_from_vehicle: FloatArray, range_m: float
) -> tuple[Diagnostic, ...]:
    """Report from which frame on the position is too uncertain, relative to the length of the path.

    Args:
        uncertainty: of N poses.
        world_from_vehicle: (N, 4, 4) poses.
        range_m: typical range of the landmarks.
    """
    sigma_m = np.sqrt(np.linalg.eigvalsh(uncertainty.pose[:, 3:, 3:])[:, -1])
    path_m = float(np.linalg.norm(np.diff(world_from_vehicle[:, :3, 3], axis=0), axis=1).sum())
    uncertain = np.asarray(sigma_m > MAX_RELATIVE_SIGMA * max(path_m, MIN_PATH_RANGES * range_m))
    if not uncertain.any():
        return ()
    first = int(np.argmax(uncertain))
    message = (
        f"the trajectory is not to be trusted from frame {first} on: its position is uncertain by "
        f"{sigma_m[first]:.2g} m there and {sigma_m[-1]:.2g} m at the end (one sigma), on a path of "
        f"{path_m:.2g} m"
    )
    return (Diagnostic("position-uncertainty", message, frame_runs(uncertain)),)


def _join(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
