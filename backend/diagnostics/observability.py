"""Which directions of the poses the data do not hold, and from where a trajectory is not to be trusted."""

import numpy as np

from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.marginal_covariance import Uncertainty
from asfm.diagnostics import Diagnostic, FrameRuns, format_runs, frame_runs
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.types import BoolArray, FloatArray

SPAN = 10
"""Frames over which a motion is judged: what sonar adds to a single step is little, and adds up."""
UNOBSERVED_RATIO = 0.9
"""Standard deviation over that without sonar and navigation from which on a direction is held by the steps alone."""
MIN_RUN = 5
"""Shorter runs of frames are not reported."""
DOUBT = 0.1
"""Standard deviation of the position, over the length of the path, from which on the trajectory is in doubt."""
LEAST_PATH = 0.1
"""A path shorter than this share of the range is taken for so long: a sonar that stands still has none."""
DIRECTIONS = ("roll", "pitch", "yaw", "forward motion", "sideways motion", "height")
"""In the vehicle's frame, as the covariances have them."""


def warn_of_unreliable_poses(solution: Solution, uncertainty: Uncertainty) -> tuple[Diagnostic, ...]:
    """Say in one sentence each what the poses owe to no measurement, and from where they are in doubt."""
    used = solution.observed
    if not used.any():
        return ()
    range_m = float(np.median(solution.tracks.range_m[used]))
    doubt = warn_of_position_uncertainty(uncertainty, solution.bundle.world_from_vehicle, range_m)
    return (*warn_of_unobserved_directions(uncertainty, solution.problem.sensors), *doubt)


def warn_of_unobserved_directions(uncertainty: Uncertainty, sensors: SensorConstraints) -> tuple[Diagnostic, ...]:
    """Say by name which directions only the odometry, or the assumption of little motion, holds, and in which frames.

    Args:
        uncertainty: measured over spans of :data:`SPAN` frames, or fewer in a shorter sequence.
        sensors: the steps and their sigmas.
    """
    held = find_unobserved_directions(uncertainty, sensors)
    directions: dict[FrameRuns, list[str]] = {}
    for axis, name in enumerate(DIRECTIONS):
        runs = frame_runs(held[:, axis], MIN_RUN)
        if runs:
            directions.setdefault(runs, []).append(name)
    holder = "the odometry" if sensors.measured else "the assumption that the vehicle moves little"
    return tuple(
        Diagnostic(
            "unobserved-directions",
            f"{_join(names)} {'is' if len(names) == 1 else 'are'} held by {holder} alone in frames {format_runs(runs)}",
            runs,
        )
        for runs, names in directions.items()
    )


def find_unobserved_directions(uncertainty: Uncertainty, sensors: SensorConstraints) -> BoolArray:
    """Find the directions in which nothing but the steps tells a motion: (N, 6), true in all frames of such spans."""
    count, spans = len(uncertainty.pose), len(uncertainty.span)
    span = count - spans
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(sensors.step_sigma**2, axis=0)])
    prior = np.sqrt(total[span:] - total[:spans])  # rotation and translation of each span without the sonar
    sigma = np.sqrt(np.maximum(np.diagonal(uncertainty.span, axis1=1, axis2=2), 0))
    loose = sigma >= UNOBSERVED_RATIO * np.repeat(prior, 3, axis=1)
    held = np.zeros((count, 6), dtype=bool)
    for shift in range(span + 1):
        held[shift : shift + spans] |= loose
    return held


def warn_of_position_uncertainty(
    uncertainty: Uncertainty, world_from_vehicle: FloatArray, range_m: float
) -> tuple[Diagnostic, ...]:
    """Say from which frame on the position is too uncertain to be trusted, if it is.

    Args:
        uncertainty: of the poses, relative to the first one or to the world.
        world_from_vehicle: (N, 4, 4)
        range_m: a typical one of the landmarks.
    """
    sigma_m = np.sqrt(np.linalg.eigvalsh(uncertainty.pose[:, 3:, 3:])[:, -1])
    path_m = float(np.linalg.norm(np.diff(world_from_vehicle[:, :3, 3], axis=0), axis=1).sum())
    doubtful = np.asarray(sigma_m > DOUBT * max(path_m, LEAST_PATH * range_m))
    if not doubtful.any():
        return ()
    first = int(np.argmax(doubtful))
    message = (
        f"the trajectory is not to be trusted from frame {first} on: its position is uncertain by "
        f"{sigma_m[first]:.2g} m there and {sigma_m[-1]:.2g} m at the end (one sigma), on a path of "
        f"{path_m:.2g} m"
    )
    return (Diagnostic("position-uncertainty", message, frame_runs(doubtful)),)


def _join(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
