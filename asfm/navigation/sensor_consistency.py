"""Consistency of odometry with depth and attitude: drift, sign, time offset and initial attitude."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.diagnostics import Diagnostic
from asfm.geometry.poses import depth_roll_pitch, heading, invert, make_pose, wrap_angle
from asfm.navigation.depth_attitude import CHANNELS, UNITS, DepthAttitude
from asfm.navigation.outlier_filter import MAD_TO_SIGMA
from asfm.types import BoolArray, FloatArray, SensorNoise

LAG_FRAMES = 8
"""Changes are compared over this many frames: over a single step noise dominates."""
CONFLICT_SIGMAS = 4.0
"""Odometry and a sensor contradict each other when their changes differ by more than this many sigmas (by MAD)."""
OFFSET_SIGMAS = 8.0
"""Initial values that differ by more than this many sigmas are in different world frames."""
MAX_OFFSET_FRAMES = 20
"""Largest time offset that is searched."""
MIN_CHANGES = 12
"""With fewer measured changes nothing is tested."""
INITIAL_FRAMES = 5
"""Measured frames whose median gives the initial offset."""


@dataclass(frozen=True)
class SensorConsistency:
    """Comparison of the changes of height, roll and pitch by odometry and by navigation, (3,) each."""

    difference: FloatArray
    """Standard deviation of the difference of the changes (by MAD), in metres and radians."""
    expected: FloatArray
    """Standard deviation of the same under the stated noise."""
    mirrored: BoolArray
    """Whether the changes agree better with the opposite sign."""

    @property
    def contradicts(self) -> BoolArray:
        """Which (3,) channels contradict each other."""
        return np.asarray(self.difference > CONFLICT_SIGMAS * self.expected)


def compare_odometry_attitude(
    world_from_vehicle: FloatArray, depth_attitude: DepthAttitude, noise: SensorNoise
) -> SensorConsistency:
    """Compare the changes of height, roll and pitch by odometry and by navigation over :data:`LAG_FRAMES` frames.

    Args:
        world_from_vehicle: (N, 4, 4) odometry.
        depth_attitude: readings at the same frames.
        noise: stated noise of both.
    """
    count = len(world_from_vehicle)
    lag = min(LAG_FRAMES, count // 2)
    untested = SensorConsistency(np.zeros(3), np.ones(3), np.zeros(3, dtype=bool))
    if not len(depth_attitude.sigma) or lag < 1:
        return untested
    by_odometry = depth_roll_pitch(world_from_vehicle)
    by_odometry, by_navigation = by_odometry[lag:] - by_odometry[:-lag], _changes(depth_attitude.z_roll_pitch, lag)
    measured = _measured_frames(depth_attitude)
    known = measured[lag:] & measured[:-lag]
    if known.sum() < MIN_CHANGES:
        return untested
    difference = MAD_TO_SIGMA * np.median(np.abs(by_navigation - by_odometry)[known], axis=0)
    mirrored_difference = MAD_TO_SIGMA * np.median(np.abs(by_navigation + by_odometry)[known], axis=0)
    path_m = np.linalg.norm(world_from_vehicle[lag:, :3, 3] - world_from_vehicle[:-lag, :3, 3], axis=1)[known]
    turn_rad = noise.odometry_rotation_rad * np.sqrt(lag)
    drift_m = np.hypot(noise.odometry_translation_m * np.sqrt(lag), turn_rad * float(np.median(path_m)))
    expected = np.hypot(np.sqrt(2.0) * _navigation_sigma(noise), [drift_m, turn_rad, turn_rad])
    return SensorConsistency(difference, expected, np.asarray(mirrored_difference < 0.5 * difference))


def _changes(z_roll_pitch: FloatArray, lag: int) -> FloatArray:
    change = z_roll_pitch[lag:] - z_roll_pitch[:-lag]
    change[:, 1] = wrap_angle(change[:, 1])
    return change


def _measured_frames(depth_attitude: DepthAttitude) -> BoolArray:
    return np.asarray(np.isfinite(depth_attitude.sigma).all(axis=1))


def _navigation_sigma(noise: SensorNoise) -> FloatArray:
    return np.array([noise.navigation_z_m, noise.navigation_roll_rad, noise.navigation_pitch_rad])


def estimate_time_offset(
    world_from_vehicle: FloatArray, depth_attitude: DepthAttitude, noise: SensorNoise
) -> int | None:
    """Estimate the number of frames by which odometry must be shifted to agree with roll and pitch.

    A shift is accepted where roll or pitch contradict each other without a mirrored sign, and where it brings all
    channels to less than half of what counts as a contradiction.

    Args:
        world_from_vehicle: (N, 4, 4) odometry.
        depth_attitude: readings at the same frames.
        noise: stated noise of both.

    Returns:
        Number of frames, positive where the odometry lags behind; None where no shift is accepted.
    """
    consistency = compare_odometry_attitude(world_from_vehicle, depth_attitude, noise)
    if not consistency.contradicts[1:].any() or consistency.mirrored[consistency.contradicts].any():
        return None
    count = len(world_from_vehicle)
    limit = min(MAX_OFFSET_FRAMES, count // 3)
    ratio = {}
    for shift in range(-limit, limit + 1):
        of_readings = slice(max(-shift, 0), count - max(shift, 0))
        of_odometry = slice(max(shift, 0), count - max(-shift, 0))
        readings = DepthAttitude(depth_attitude.z_roll_pitch[of_readings], depth_attitude.sigma[of_readings])
        shifted = compare_odometry_attitude(world_from_vehicle[of_odometry], readings, noise)
        tested = shifted.difference.any()
        ratio[shift] = float(np.max(shifted.difference / shifted.expected)) if tested else np.inf
    best = min(ratio, key=lambda shift: ratio[shift])
    return best if best != 0 and ratio[best] < 0.5 * CONFLICT_SIGMAS else None


def describe_conflicts(consistency: SensorConsistency) -> tuple[str, ...]:
    """Describe which of height, roll and pitch contradict each other, one sentence each."""
    sentences = []
    for channel in np.flatnonzero(consistency.contradicts).tolist():
        scale, unit = UNITS[channel]
        how = ": they have opposite signs, one is mirrored" if consistency.mirrored[channel] else ""
        sentences.append(
            f"odometry and navigation contradict each other in the {CHANNELS[channel]}: over {LAG_FRAMES} frames they "
            f"differ by {scale * float(consistency.difference[channel]):.2g} {unit} in the median, where "
            f"{scale * float(consistency.expected[channel]):.2g} {unit} are expected{how}"
        )
    return tuple(sentences)


def align_initial_attitude(
    world_from_vehicle: FloatArray, depth_attitude: DepthAttitude, noise: SensorNoise, trusted: BoolArray
) -> tuple[FloatArray, tuple[Diagnostic, ...]]:
    """Align odometry that starts in another world frame with the initial height, roll and pitch of navigation.

    Args:
        world_from_vehicle: (N, 4, 4) odometry.
        depth_attitude: readings at the same frames.
        noise: stated noise of both.
        trusted: (3,) which of height, roll and pitch are aligned.

    Returns:
        (N, 4, 4) poses, unchanged where they start within a few sigmas of navigation, and a diagnostic where not.
    """
    offset, limit = _initial_offset(world_from_vehicle, depth_attitude, noise)
    far = trusted & (np.abs(offset) > limit)
    if not far.any():
        return world_from_vehicle, ()
    first = world_from_vehicle[0]
    z_m, roll_rad, pitch_rad = depth_roll_pitch(first[None])[0] + np.where(far, offset, 0.0)
    rotation = Rotation.from_euler("ZYX", [heading(first), pitch_rad, roll_rad])
    aligned = make_pose(np.array([*first[:2, 3], z_m]), rotation)
    offsets = ", ".join(
        f"{scale * float(offset[channel]):+.2g} {unit} of {CHANNELS[channel]}"
        for channel, (scale, unit) in enumerate(UNITS)
        if far[channel]
    )
    message = (
        f"odometry starts in another frame than navigation, offset by {offsets}: its poses are moved to navigation's"
    )
    moved = Diagnostic("odometry-frame-offset", message)
    return np.asarray(aligned @ invert(first) @ world_from_vehicle), (moved,)


def _initial_offset(
    world_from_vehicle: FloatArray, depth_attitude: DepthAttitude, noise: SensorNoise
) -> tuple[FloatArray, FloatArray]:
    """Return navigation minus odometry at the first measured frames, (3,) metres and radians, and (3,) its limit.

    The offset is zero where nothing is measured at the start.
    """
    frames = np.flatnonzero(_measured_frames(depth_attitude))[:INITIAL_FRAMES]
    if not len(frames) or frames[0] > LAG_FRAMES:
        return np.zeros(3), np.ones(3)
    offset = np.median(depth_attitude.z_roll_pitch[frames] - depth_roll_pitch(world_from_vehicle[frames]), axis=0)
    offset[1:] = wrap_angle(offset[1:])
    steps = np.sqrt(float(frames[-1]) + 1)
    drift = steps * np.array([noise.odometry_translation_m, noise.odometry_rotation_rad, noise.odometry_rotation_rad])
    return offset, OFFSET_SIGMAS * np.hypot(drift, _navigation_sigma(noise))
