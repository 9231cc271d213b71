"""Odometry as steps between frames: steps that jump are not believed, gaps make them vague."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.config import BackendConfig
from asfm.diagnostics import Diagnostic, format_runs, frame_runs
from asfm.geometry.poses import chain_steps, interpolate, make_pose, steps_between
from asfm.navigation.depth_attitude import frames_per_reading
from asfm.navigation.outlier_filter import FEWEST, MAD_TO_SIGMA, SIGMAS, running_median
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, SensorNoise

GAP_FACTOR = 1.5
"""Sigma of a step that odometry does not know, over its typical step."""
JUMP_FACTOR = 3.0
"""A step jumps only when it departs from its neighbours by this many times what they are."""

MAX_JUMPS = 4
"""Diagnostics describe so many jumps one by one; the others are counted."""


@dataclass(frozen=True)
class Odometry:
    """Dead-reckoned poses at the frames, and how sure their steps are."""

    world_from_vehicle: FloatArray
    """(N, 4, 4), without the steps that were not believed."""
    step_sigma: FloatArray
    """(N - 1, 2) standard deviations of the steps' rotation in rad and translation in m, each axis."""
    diagnostics: tuple[Diagnostic, ...] = ()
    unreliable: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """(N - 1,) which steps jump, or lie where no reading is near."""


def read_odometry(sequence: Sequence, config: BackendConfig) -> Odometry | None:
    """Read the odometry at the frames' stamps; None where there is none, it is not wanted, or of another time.

    A step that departs from the running median of the steps around it, where these agree with each other, is a jump
    of the sensor: the median takes its place, and its sigma says that little is known. Steps in a gap of the
    odometry, or outside its time, are vague too.
    """
    odometry = sequence.odometry
    if odometry is None or not config.use_odometry or not len(odometry.timestamps_s):
        return None
    poses = interpolate(odometry.timestamps_s, odometry.world_from_vehicle, sequence.timestamps_s)
    noise = sequence.noise
    sigma = np.tile([noise.odometry_rotation_rad, noise.odometry_translation_m], (len(poses) - 1, 1))
    read = Odometry(poses, sigma, (), np.zeros(len(sigma), dtype=bool))
    return _widen_gaps(_repair_jumps(read, np.diff(sequence.timestamps_s), noise), sequence)


def _repair_jumps(odometry: Odometry, elapsed_s: FloatArray, noise: SensorNoise) -> Odometry:
    """Put the median of their neighbours in the place of steps that jump."""
    poses = odometry.world_from_vehicle
    if len(poses) <= FEWEST:
        return odometry
    steps = steps_between(poses)
    turn_rad, shift_m = Rotation.from_matrix(steps[:, :3, :3]).as_rotvec(), steps[:, :3, 3].copy()
    pace = (elapsed_s / np.median(elapsed_s))[:, None]  # a step over lost pings is long, and no jump
    turns = _find_jumps(turn_rad / pace, noise.odometry_rotation_rad)
    shifts = _find_jumps(shift_m / pace, noise.odometry_translation_m)
    jumps = turns[0] | shifts[0]
    if not jumps.any():
        return odometry
    steps[jumps] = make_pose((shifts[1] * pace)[jumps], Rotation.from_rotvec((turns[1] * pace)[jumps]))
    chain = chain_steps(poses[0], steps)
    repaired = make_pose(chain[:, :3, 3], Rotation.from_matrix(chain[:, :3, :3]))
    unknown = _unknown_step(turn_rad[~jumps], shift_m[~jumps])
    sigma = odometry.step_sigma.copy()
    sigma[jumps] = np.hypot(sigma[jumps], unknown * pace[jumps])
    return Odometry(repaired, sigma, _diagnose_jumps(jumps, turn_rad, shift_m), jumps)


def _find_jumps(steps: FloatArray, sigma: float) -> tuple[BoolArray, FloatArray]:
    """Tell which of (N, 3) steps jump: (N,), and the running median (N, 3)."""
    usual = running_median(steps)
    away = np.linalg.norm(steps - usual, axis=1)
    typical = MAD_TO_SIGMA * float(np.median(away))
    limit = np.maximum(SIGMAS * max(sigma, typical), JUMP_FACTOR * np.linalg.norm(usual, axis=1))
    return np.asarray(away > limit), usual


def _unknown_step(turn_rad: FloatArray, shift_m: FloatArray) -> FloatArray:
    """Sigmas (2,) of a step that nobody measured: of the size of those that somebody did."""
    return GAP_FACTOR * np.sqrt([np.mean(turn_rad**2), np.mean(shift_m**2)]) if len(turn_rad) else np.zeros(2)


def _widen_gaps(odometry: Odometry, sequence: Sequence) -> Odometry:
    """Make the steps vague that begin or end where no reading is near."""
    source = sequence.odometry
    assert source is not None
    far = ~np.isfinite(frames_per_reading(source.timestamps_s, sequence.timestamps_s))
    if not far.any():
        return odometry
    unknown = far[:-1] | far[1:]
    steps = steps_between(odometry.world_from_vehicle)
    known = steps[~unknown]
    typical = _unknown_step(Rotation.from_matrix(known[:, :3, :3]).as_rotvec(), known[:, :3, 3]) if len(known) else 0.0
    sigma = odometry.step_sigma.copy()
    farthest_m = float(sequence.sonar.range_edges_m[-1])
    sigma[unknown] = np.hypot(sigma[unknown], np.maximum(typical, [1e-3, 1e-3 * farthest_m]))
    runs = frame_runs(far)
    message = f"odometry: no reading near {int(far.sum())} of {len(far)} frames ({format_runs(runs)})"
    if len(sigma):
        turn_deg, shift_m = np.rad2deg(sigma[unknown, 0].max()), sigma[unknown, 1].max()
        message += f": the steps there get sigmas of {turn_deg:.2g} deg and {shift_m:.2g} m"
    diagnostics = (*odometry.diagnostics, Diagnostic("odometry-gap", message, runs))
    return replace(odometry, step_sigma=sigma, diagnostics=diagnostics, unreliable=odometry.unreliable | unknown)


def _diagnose_jumps(jumps: BoolArray, turn_rad: FloatArray, shift_m: FloatArray) -> tuple[Diagnostic, ...]:
    size_m, size_deg = np.linalg.norm(shift_m, axis=1), np.rad2deg(np.linalg.norm(turn_rad, axis=1))
    usual_m, usual_deg = float(np.median(size_m[~jumps])), float(np.median(size_deg[~jumps]))
    indices = np.flatnonzero(jumps).tolist()
    found = []
    for index in indices[:MAX_JUMPS]:
        message = (
            f"odometry jumps by {size_m[index]:.2g} m and {size_deg[index]:.2g} deg between frames {index} and "
            f"{index + 1}, where its typical step is {usual_m:.2g} m and {usual_deg:.2g} deg: that step is rejected"
        )
        found.append(Diagnostic("odometry-jump", message, ((index, index + 1),)))
    if len(indices) > MAX_JUMPS:
        message = f"odometry jumps at {len(indices) - MAX_JUMPS} more steps: they are rejected too"
        found.append(Diagnostic("odometry-jump", message, tuple((i, i + 1) for i in indices[MAX_JUMPS:])))
    return tuple(found)
