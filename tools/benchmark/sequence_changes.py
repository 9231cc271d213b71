"""Changes of a sequence that stand for mistakes in a recording: geometry, mounting, clocks, units, axes and order."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import make_pose
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, Frame, ImageArray, IntArray, Navigation, Trajectory

Order = Callable[[int], IntArray]
Turn = Callable[[ImageArray | BoolArray], ImageArray | BoolArray]
NORTH_EAST_DOWN = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FORWARD_STARBOARD_DOWN = np.diag([1.0, -1.0, -1.0])
LOST_S = 1.0
"""Time whose images are lost."""


def change_sonar(
    sequence: Sequence, range_scale: float = 1.0, near_m: float = 0.0, bearing_scale: float = 1.0
) -> Sequence:
    """State another range window or field of view; near_m moves the near edge and leaves the far one."""
    sonar = sequence.sonar
    share = np.linspace(1.0, 0.0, len(sonar.range_m))
    range_m = range_scale * sonar.range_m + near_m * share
    changed = SonarModel(sonar.name, range_m, bearing_scale * sonar.bearing_rad, sonar.elevation_aperture_rad)
    return replace(sequence, sonar=changed)


def turn_mounting(sequence: Sequence, yaw_pitch_roll_deg: tuple[float, float, float], lever_m: FloatArray) -> Sequence:
    """State a mounting turned by yaw, pitch and roll about the sonar's axes and moved by a lever arm, (3,) m."""
    turn = make_pose(lever_m, Rotation.from_euler("ZYX", yaw_pitch_roll_deg, degrees=True))
    return replace(sequence, vehicle_from_sonar=sequence.vehicle_from_sonar @ turn)


def change_odometry(sequence: Sequence, change: Callable[[FloatArray], FloatArray], late_s: float = 0.0) -> Sequence:
    """Change the poses of the odometry by a function of (N, 4, 4), and stamp them late."""
    odometry = sequence.odometry
    if odometry is None:
        return sequence
    changed = Trajectory(odometry.timestamps_s + late_s, change(odometry.world_from_vehicle))
    return replace(sequence, odometry=changed)


def scale_positions(poses: FloatArray, factor: float) -> FloatArray:
    """Scale the positions of (N, 4, 4) poses about the first one."""
    scaled = poses.copy()
    scaled[:, :3, 3] = poses[0, :3, 3] + factor * (poses[:, :3, 3] - poses[0, :3, 3])
    return scaled


def read_w_first(poses: FloatArray) -> FloatArray:
    """Read quaternions written w x y z as x y z w."""
    quaternion = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    return make_pose(poses[:, :3, 3], Rotation.from_quat(np.roll(quaternion, 1, axis=1)))


def convert_to_marine(poses: FloatArray) -> FloatArray:
    """Convert to a world north-east-down and a body forward-starboard-down."""
    rotation = Rotation.from_matrix(NORTH_EAST_DOWN @ poses[:, :3, :3] @ FORWARD_STARBOARD_DOWN)
    return make_pose(poses[:, :3, 3] @ NORTH_EAST_DOWN.T, rotation)


def scale_navigation(sequence: Sequence, factors: tuple[float, float, float], swapped: bool = False) -> Sequence:
    """Multiply height, roll and pitch, or swap the angles."""
    readings = sequence.navigation
    if readings is None:
        return sequence
    roll_rad, pitch_rad = factors[1] * readings.roll_rad, factors[2] * readings.pitch_rad
    angles = (pitch_rad, roll_rad) if swapped else (roll_rad, pitch_rad)
    return replace(sequence, navigation=Navigation(readings.timestamps_s, factors[0] * readings.z_m, *angles))


def delay_navigation(sequence: Sequence, late_s: float) -> Sequence:
    """Stamp depth and attitude late."""
    readings = sequence.navigation
    if readings is None:
        return sequence
    return replace(sequence, navigation=replace(readings, timestamps_s=readings.timestamps_s + late_s))


def change_images(
    sequence: Sequence,
    order: Order = np.arange,
    turn: Turn = lambda image: image,
) -> Sequence:
    """Show the images in another order, or turned."""
    numbers, read = order(len(sequence)), sequence.read_frame

    def read_frame(index: int) -> Frame:
        frame = read(int(numbers[index]))
        image = np.ascontiguousarray(turn(frame.image)).astype(np.float32)
        invalid = np.ascontiguousarray(turn(frame.invalid)).astype(bool)
        stamp_s = float(sequence.timestamps_s[index])
        return replace(frame, index=index, timestamp_s=stamp_s, image=image, invalid=invalid)

    return replace(sequence, read_frame=read_frame)


def close_gap(sequence: Sequence) -> Sequence:
    """Lose the images of a second in the middle, and let the stamps of the later ones close up."""
    count = len(sequence)
    lost = round(LOST_S / float(np.median(np.diff(sequence.timestamps_s))))
    kept = np.delete(np.arange(count), np.arange(count // 2, count // 2 + lost))
    stamps_s, truth = sequence.timestamps_s[: len(kept)], sequence.groundtruth
    moved = change_images(sequence, lambda _: np.append(kept, np.zeros(lost, dtype=np.int64)))
    if truth is not None:
        truth = Trajectory(stamps_s, truth.world_from_vehicle[kept])
    return replace(moved, timestamps_s=stamps_s, groundtruth=truth)


def convert_all_to_marine(sequence: Sequence) -> Sequence:
    """Convert odometry, depth and attitude to north-east-down and forward-starboard-down."""
    return scale_navigation(change_odometry(sequence, convert_to_marine), (-1, 1, -1))


def shuffle(count: int) -> IntArray:
    """Return a permutation, always the same."""
    return np.random.default_rng(3).permutation(count)


def sort_as_text(count: int) -> IntArray:
    """Return the order in which a listing sorts numbers without leading zeros: 0, 1, 10, 11, 2 ..."""
    return np.array(sorted(range(count), key=str))


def delay_by_one(count: int) -> IntArray:
    """Return each index one late; the first twice."""
    return np.maximum(np.arange(count) - 1, 0)


def delay_all_sensors(sequence: Sequence) -> Sequence:
    """Stamp odometry, depth and attitude half a second late."""
    return delay_navigation(change_odometry(sequence, np.asarray, 0.5), 0.5)
