"""Odometry at the frame times: outlier steps (jumps) replaced by the running median, steps in gaps down-weighted."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.config import BackendConfig
from asfm.diagnostics import Diagnostic, format_runs, frame_runs
from asfm.geometry.poses import chain_steps, interpolate, make_pose, steps_between
from asfm.navigation.depth_attitude import frames_per_reading
from asfm.navigation.outlier_filter import MAD_TO_SIGMA, MIN_READINGS, OUTLIER_SIGMAS, running_median
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, SensorNoise

UNKNOWN_STEP_FACTOR = 1.5
"""Sigma of a step that odometry did not measure, over the root mean square of the measured ones."""
JUMP_FACTOR = 3.0
"""A jump differs from the running median by at least this many times the median's length."""
MIN_STEP_SIGMA = 1e-3
"""Smallest sigma of an unmeasured step, in radians and in metres per metre of the sonar's range."""
MAX_LISTED_JUMPS = 4
"""Diagnostics describe at most this many jumps one by one; the others are counted."""


@dataclass(frozen=True)
class Odometry:
    """Dead-reckoned poses at the frame times, and the uncertainty of their steps."""

    world_from_vehicle: FloatArray
    """(N, 4, 4), jumps removed."""
    step_sigma: FloatArray
    """(N - 1, 2) standard deviations of the steps' rotation in rad and translation in m, each axis."""
    diagnostics: tuple[Diagnostic, ...] = ()
    unreliable: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """(N - 1,) which steps were jumps, or lie where no reading is near."""


def read_odometry(sequence: Sequence, config: BackendConfig) -> Odometry | None:
    """Interpolate the odometry at the frame times, and repair jumps and gaps.

    A step that differs from the running median of the steps around it is a jump of the sensor: it is replaced by the
    median, with a sigma as large as a typical step. Steps in a gap of the odometry, or outside its time, get such a
    sigma too.

    Args:
        sequence: frame times, odometry and its stated noise.
        config: whether odometry is used.

    Returns:
        None where there is no odometry or it is not used.
    """
    odometry = sequence.odometry
    if odometry is None or not config.use_odometry or not len(odometry.timestamps_s):
        return None
    poses = interpolate(odometry.timestamps_s, odometry.world_from_vehicle, sequence.timestamps_s)
    noise = sequence.noise
    sigma = np.tile([noise.odometry_rotation_rad, noise.odometry_translation_m], (len(poses) - 1, 1))
    recorded = Odometry(poses, sigma, (), np.zeros(len(sigma), dtype=bool))
    return _widen_gaps(_repair_jumps(recorded, np.diff(sequence.timestamps_s), noise), sequence)


def _repair_jumps(odometry: Odometry, elapsed_s: FloatArray, noise: SensorNoise) -> Odometry:
    """Replace steps that jump by the running median."""
    poses = odometry.world_from_vehicle
    if len(poses) <= MIN_READINGS:
        return odometry
    steps = steps_between(poses)
    turn_rad, shift_m = Rotation.from_matrix(steps[:, :3, :3]).as_rotvec(), steps[:, :3, 3].copy()
    duration = (elapsed_s / np.median(elapsed_s))[:, None]  # a step over missing frames is long without being a jump
    turn_jumps, median_turn_rad = _find_jumps(turn_rad / duration, noise.odometry_rotation_rad)
    shift_jumps, median_shift_m = _find_jumps(shift_m / duration, noise.odometry_translation_m)
    jumps = turn_jumps | shift_jumps
    if not jumps.any():
        return odometry
    steps[jumps] = make_pose(
        (median_shift_m * duration)[jumps], Rotation.from_rotvec((median_turn_rad * duration)[jumps])
    )
    chain = chain_steps(poses[0], steps)
    repaired = make_pose(chain[:, :3, 3], Rotation.from_matrix(chain[:, :3, :3]))
    unknown_sigma = _unknown_step_sigma(turn_rad[~jumps], shift_m[~jumps])
    sigma = odometry.step_sigma.copy()
    sigma[jumps] = np.hypot(sigma[jumps], unknown_sigma * duration[jumps])
    return Odometry(repaired, sigma, _diagnose_jumps(jumps, turn_rad, shift_m), jumps)


def _find_jumps(steps: FloatArray, sigma: float) -> tuple[BoolArray, FloatArray]:
    """Return which (N,) of the (N, 3) steps jump, and their (N, 3) running median."""
    median = running_median(steps)
    deviation = np.linalg.norm(steps - median, axis=1)
    typical = MAD_TO_SIGMA * float(np.median(deviation))
    limit = np.maximum(OUTLIER_SIGMAS * max(sigma, typical), JUMP_FACTOR * np.linalg.norm(median, axis=1))
    return np.asarray(deviation > limit), median


def _unknown_step_sigma(turn_rad: FloatArray, shift_m: FloatArray) -> FloatArray:
    """Return the sigmas (2,) in rad and m of an unmeasured step, from the (K, 3) rotations and translations of others.

    Zero where there are no others.
    """
    if not len(turn_rad):
        return np.zeros(2)
    return np.asarray(UNKNOWN_STEP_FACTOR * np.sqrt([np.mean(turn_rad**2), np.mean(shift_m**2)]))


def _widen_gaps(odometry: Odometry, sequence: Sequence) -> Odometry:
    """Increase the sigmas of the steps that begin or end where no reading is near."""
    recorded = sequence.odometry
    assert recorded is not None
    gap = ~np.isfinite(frames_per_reading(recorded.timestamps_s, sequence.timestamps_s))
    if not gap.any():
        return odometry
    unknown = gap[:-1] | gap[1:]
    known = steps_between(odometry.world_from_vehicle)[~unknown]
    typical = (
        _unknown_step_sigma(Rotation.from_matrix(known[:, :3, :3]).as_rotvec(), known[:, :3, 3]) if len(known) else 0.0
    )
    sigma = odometry.step_sigma.copy()
    max_range_m = float(sequence.sonar.range_edges_m[-1])
    sigma[unknown] = np.hypot(sigma[unknown], np.maximum(typical, [MIN_STEP_SIGMA, MIN_STEP_SIGMA * max_range_m]))
    runs = frame_runs(gap)
    message = f"odometry: no reading near {int(gap.sum())} of {len(gap)} frames ({format_runs(runs)})"
    if len(sigma):
        turn_deg, shift_m = np.rad2deg(sigma[unknown, 0].max()), sigma[unknown, 1].max()
        message += f": the steps there get sigmas of {turn_deg:.2g} deg and {shift_m:.2g} m"
    diagnostics = (*odometry.diagnostics, Diagnostic("odometry-gap", message, runs))
    return replace(odometry, step_sigma=sigma, diagnostics=diagnostics, unreliable=odometry.unreliable | unknown)


def _diagnose_jumps(jumps: BoolArray, turn_rad: FloatArray, shift_m: FloatArray) -> tuple[Diagnostic, ...]:
    size_m, size_deg = np.linalg.norm(shift_m, axis=1), np.rad2deg(np.linalg.norm(turn_rad, axis=1))
    typical_m, typical_deg = float(np.median(size_m[~jumps])), float(np.median(size_deg[~jumps]))
    indices = np.flatnonzero(jumps).tolist()
    found = []
    for index in indices[:MAX_LISTED_JUMPS]:
        message = (
            f"odometry jumps by {size_m[index]:.2g} m and {size_deg[index]:.2g} deg between frames {index} and "
            f"{index + 1}, where its typical step is {typical_m:.2g} m and {typical_deg:.2g} deg: that step is rejected"
        )
        found.append(Diagnostic("odometry-jump", message, ((index, index + 1),)))
    if len(indices) > MAX_LISTED_JUMPS:
        message = f"odometry jumps at {len(indices) - MAX_LISTED_JUMPS} more steps: they are rejected too"
        found.append(Diagnostic("odometry-jump", message, tuple((i, i + 1) for i in indices[MAX_LISTED_JUMPS:])))
    return tuple(found)
