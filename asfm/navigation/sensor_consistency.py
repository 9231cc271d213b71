"""Whether odometry and navigation tell of the same motion: height, roll and pitch are measured by both."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.diagnostics import Diagnostic
from asfm.geometry.poses import depth_roll_pitch, heading, invert, make_pose, wrap_angle
from asfm.navigation.depth_attitude import CHANNELS, UNITS, DepthAttitude
from asfm.types import BoolArray, FloatArray, SensorNoise

LAG = 8
"""Changes are compared over this many frames: over one step noise hides them."""
SIGMAS = 4.0
"""Changes that differ by this many of their sigmas in the typical case contradict each other."""
OFFSET_SIGMAS = 8.0
"""A start that differs by as many is in another world."""
MAX_SHIFT = 20
"""Frames by which odometry's stamps may be wrong."""
FEWEST = 12
"""Changes below which nothing is said."""
MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True)
class SensorConsistency:
    """How the changes of height, roll and pitch compare, (3,) each."""

    differs: FloatArray
    """Typical difference between the changes of the two, in metres and radians."""
    expected: FloatArray
    """Standard deviation that the stated noise makes of it."""
    mirrored: BoolArray
    """Whether the changes agree better with the opposite sign."""

    @property
    def contradicts(self) -> BoolArray:
        """Which of the three contradict each other."""
        return np.asarray(self.differs > SIGMAS * self.expected)


def compare_odometry_attitude(
    world_from_vehicle: FloatArray, depth_attitude: DepthAttitude, noise: SensorNoise
) -> SensorConsistency:
    """Compare how height, roll and pitch change by odometry, (N, 4, 4), and by navigation, over a few frames."""
    count = len(world_from_vehicle)
    lag = min(LAG, count // 2)
    silent = SensorConsistency(np.zeros(3), np.ones(3), np.zeros(3, dtype=bool))
    if not len(depth_attitude.sigma) or lag < 1:
        return silent
    by_odometry = depth_roll_pitch(world_from_vehicle)
    by_odometry, by_navigation = by_odometry[lag:] - by_odometry[:-lag], _changes(depth_attitude.z_roll_pitch, lag)
    measured = np.asarray(np.isfinite(depth_attitude.sigma).all(axis=1))
    known = measured[lag:] & measured[:-lag]
    if known.sum() < FEWEST:
        return silent
    differs = MAD_TO_SIGMA * np.median(np.abs(by_navigation - by_odometry)[known], axis=0)
    opposed = MAD_TO_SIGMA * np.median(np.abs(by_navigation + by_odometry)[known], axis=0)
    path_m = np.linalg.norm(world_from_vehicle[lag:, :3, 3] - world_from_vehicle[:-lag, :3, 3], axis=1)[known]
    turn_rad = noise.odometry_rotation_rad * np.sqrt(lag)
    drift_m = np.hypot(noise.odometry_translation_m * np.sqrt(lag), turn_rad * float(np.median(path_m)))
    of_navigation = [noise.navigation_z_m, noise.navigation_roll_rad, noise.navigation_pitch_rad]
    expected = np.hypot(np.sqrt(2.0) * np.array(of_navigation), [drift_m, turn_rad, turn_rad])
    return SensorConsistency(differs, expected, np.asarray(opposed < 0.5 * differs))


def _changes(z_roll_pitch: FloatArray, lag: int) -> FloatArray:
    change = z_roll_pitch[lag:] - z_roll_pitch[:-lag]
    change[:, 1] = wrap_angle(change[:, 1])
    return change


def estimate_time_offset(
    world_from_vehicle: FloatArray, depth_attitude: DepthAttitude, noise: SensorNoise
) -> int | None:
    """Find by how many frames odometry, (N, 4, 4), must be shifted to agree with navigation; None if that is no cure.

    A shift is believed when it takes a clear contradiction of roll or pitch, which no choice of frame explains, to
    less than half of what is a contradiction.
    """
    consistency = compare_odometry_attitude(world_from_vehicle, depth_attitude, noise)
    if not consistency.contradicts[1:].any() or consistency.mirrored[consistency.contradicts].any():
        return None
    count = len(world_from_vehicle)
    reach = min(MAX_SHIFT, count // 3)
    worst = {}
    for shift in range(-reach, reach + 1):
        of_frames = slice(max(-shift, 0), count - max(shift, 0))
        of_odometry = slice(max(shift, 0), count - max(-shift, 0))
        cut = DepthAttitude(depth_attitude.z_roll_pitch[of_frames], depth_attitude.sigma[of_frames])
        shifted = compare_odometry_attitude(world_from_vehicle[of_odometry], cut, noise)
        worst[shift] = float(np.max(shifted.differs / shifted.expected)) if shifted.differs.any() else np.inf
    best = min(worst, key=lambda shift: worst[shift])
    return best if best != 0 and worst[best] < 0.5 * SIGMAS else None


def describe_conflicts(consistency: SensorConsistency) -> tuple[str, ...]:
    """Describe which of height, roll and pitch contradict each other, one sentence each."""
    sentences = []
    for channel in np.flatnonzero(consistency.contradicts).tolist():
        scale, unit = UNITS[channel]
        how = ": they have opposite signs, one is mirrored" if consistency.mirrored[channel] else ""
        sentences.append(
            f"odometry and navigation contradict each other in the {CHANNELS[channel]}: over {LAG} frames they differ "
            f"by {scale * float(consistency.differs[channel]):.2g} {unit} in the median, where "
            f"{scale * float(consistency.expected[channel]):.2g} {unit} are expected{how}"
        )
    return tuple(sentences)


def align_initial_attitude(
    world_from_vehicle: FloatArray, depth_attitude: DepthAttitude, noise: SensorNoise, trusted: BoolArray
) -> tuple[FloatArray, tuple[Diagnostic, ...]]:
    """Move an odometry that starts in another world than navigation's to the height, roll and pitch of its start.

    Args:
        world_from_vehicle: (N, 4, 4).
        trusted: (3,) which of height, roll and pitch may move it.

    Returns:
        (N, 4, 4) poses, untouched where they start within a few sigmas of navigation, and a diagnostic where not.
    """
    known = (
        np.flatnonzero(np.isfinite(depth_attitude.sigma).all(axis=1))[:5]
        if len(depth_attitude.sigma)
        else np.zeros(0, int)
    )
    if not len(known) or known[0] > LAG:
        return world_from_vehicle, ()
    start = depth_roll_pitch(world_from_vehicle[known])
    away = np.median(depth_attitude.z_roll_pitch[known] - start, axis=0)
    away[1:] = wrap_angle(away[1:])
    steps = np.sqrt(float(known[-1]) + 1)
    drift = steps * np.array([noise.odometry_translation_m, noise.odometry_rotation_rad, noise.odometry_rotation_rad])
    stated = np.array([noise.navigation_z_m, noise.navigation_roll_rad, noise.navigation_pitch_rad])
    far = trusted & (np.abs(away) > OFFSET_SIGMAS * np.hypot(drift, stated))
    if not far.any():
        return world_from_vehicle, ()
    first = world_from_vehicle[0]
    z_m, roll_rad, pitch_rad = depth_roll_pitch(first[None])[0] + np.where(far, away, 0.0)
    yaw_rad = heading(first)
    placed = make_pose(np.array([*first[:2, 3], z_m]), Rotation.from_euler("ZYX", [yaw_rad, pitch_rad, roll_rad]))
    offsets = ", ".join(
        f"{scale * float(away[channel]):+.2g} {unit} of {CHANNELS[channel]}"
        for channel, (scale, unit) in enumerate(UNITS)
        if far[channel]
    )
    message = (
        f"odometry starts in another frame than navigation, offset by {offsets}: its poses are moved to navigation's"
    )
    moved = Diagnostic("odometry-frame-offset", message)
    return np.asarray(placed @ invert(first) @ world_from_vehicle), (moved,)
