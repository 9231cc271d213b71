"""Rigid transforms as stacks of 4 x 4 matrices, and their text form in TUM order (x y z qx qy qz qw).

SciPy's rotations are imported where they are used, so that an input that is refused earlier need not wait for them.
"""

from typing import TYPE_CHECKING

import numpy as np

from asfm.types import FloatArray

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


def make_pose(translation_m: FloatArray, rotation: "Rotation") -> FloatArray:
    """Assemble (..., 4, 4) transforms from (..., 3) translations and a rotation (a stack of as many)."""
    translation_m = np.asarray(translation_m, dtype=float)
    pose = np.zeros((*translation_m.shape[:-1], 4, 4))
    pose[..., :3, :3] = rotation.as_matrix()
    pose[..., :3, 3] = translation_m
    pose[..., 3, 3] = 1.0
    return pose


def pose_from_tum(row: FloatArray) -> FloatArray:
    """Turn (..., 7) rows x y z qx qy qz qw into (..., 4, 4) transforms; quaternions are normalised."""
    from scipy.spatial.transform import Rotation

    row = np.asarray(row, dtype=float)
    return make_pose(row[..., :3], Rotation.from_quat(row[..., 3:]))


def tum_from_pose(pose: FloatArray) -> FloatArray:
    """Turn (..., 4, 4) transforms into (..., 7) rows x y z qx qy qz qw with qw >= 0."""
    from scipy.spatial.transform import Rotation

    quaternion = Rotation.from_matrix(pose[..., :3, :3]).as_quat(canonical=True)
    return np.concatenate([pose[..., :3, 3], quaternion], axis=-1)


def invert(pose: FloatArray) -> FloatArray:
    """Invert (..., 4, 4) rigid transforms."""
    inverse = np.zeros_like(pose)
    transposed = np.swapaxes(pose[..., :3, :3], -1, -2)
    inverse[..., :3, :3] = transposed
    inverse[..., :3, 3] = -np.einsum("...ij,...j->...i", transposed, pose[..., :3, 3])
    inverse[..., 3, 3] = 1.0
    return inverse


def transform(pose: FloatArray, xyz: FloatArray) -> FloatArray:
    """Map (..., 3) points through (..., 4, 4) transforms; the leading axes broadcast."""
    return np.asarray(np.einsum("...ij,...j->...i", pose[..., :3, :3], xyz) + pose[..., :3, 3])


def interpolate(timestamps_s: FloatArray, pose: FloatArray, at_s: FloatArray) -> FloatArray:
    """Interpolate poses at other stamps: translations linearly, rotations by SLERP.

    Stamps outside take the nearest end.

    Args:
        timestamps_s: (N,) strictly rising, N >= 1.
        pose: (N, 4, 4).
        at_s: (M,).

    Returns:
        (M, 4, 4).
    """
    from scipy.spatial.transform import Rotation, Slerp

    if len(timestamps_s) == 1:
        return np.repeat(pose, len(at_s), axis=0)
    at_s = np.clip(at_s, timestamps_s[0], timestamps_s[-1])
    translation_m = np.stack([np.interp(at_s, timestamps_s, pose[:, axis, 3]) for axis in range(3)], axis=-1)
    return make_pose(translation_m, Slerp(timestamps_s, Rotation.from_matrix(pose[:, :3, :3]))(at_s))


def steps_between(pose: FloatArray) -> FloatArray:
    """Return the (N - 1, 4, 4) motions from each of (N, 4, 4) poses to the next, in the frame of the former."""
    return np.asarray(invert(pose[:-1]) @ pose[1:])


def chain_steps(first_pose: FloatArray, steps: FloatArray) -> FloatArray:
    """Return the (N, 4, 4) poses that follow from the first one, (4, 4), and (N - 1, 4, 4) steps."""
    poses = [first_pose]
    for step in steps:
        poses.append(poses[-1] @ step)
    return np.stack(poses)


def heading(pose: FloatArray) -> FloatArray:
    """Return the heading (yaw) of (..., 4, 4) poses in radians, rotation = Rz(yaw) Ry(pitch) Rx(roll)."""
    return np.asarray(np.arctan2(pose[..., 1, 0], pose[..., 0, 0]))


def depth_roll_pitch(pose: FloatArray) -> FloatArray:
    """Return (N, 3) z_m, roll_rad and pitch_rad of (N, 4, 4) poses; the roll is unwrapped along N."""
    ahead, aside, up = pose[:, 2, :3].T
    roll_rad = np.unwrap(np.arctan2(aside, up))
    return np.stack([pose[:, 2, 3], roll_rad, np.arctan2(-ahead, np.hypot(aside, up))], axis=1)


def wrap_angle(angle_rad: FloatArray) -> FloatArray:
    """Wrap angles (...,) in radians to -pi (included) .. pi (excluded)."""
    return np.asarray(np.remainder(angle_rad + np.pi, 2 * np.pi) - np.pi)


def angle_difference(first_rad: FloatArray, second_rad: FloatArray) -> FloatArray:
    """Subtract angles, broadcast together, the short way round: in -pi..pi, and exactly first - second where that is.

    Bearings of a sonar that sees behind itself jump from pi to -pi there.
    """
    difference_rad = np.asarray(first_rad - second_rad)
    beyond = np.abs(difference_rad) > np.pi
    return np.where(beyond, wrap_angle(difference_rad), difference_rad) if beyond.any() else difference_rad


def cross_matrix(vector: FloatArray) -> FloatArray:
    """Return the (..., 3, 3) matrices that multiply like the cross product with (..., 3) vectors."""
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    rows = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    return np.asarray(rows.reshape(*zero.shape, 3, 3))


def adjoint(pose: FloatArray) -> FloatArray:
    """Return the adjoint of poses, rotation first as in GTSAM: (..., 6, 6) of (..., 4, 4)."""
    rotation = pose[..., :3, :3]
    matrix = np.zeros((*pose.shape[:-2], 6, 6))
    matrix[..., :3, :3] = matrix[..., 3:, 3:] = rotation
    matrix[..., 3:, :3] = cross_matrix(pose[..., :3, 3]) @ rotation
    return matrix


def pose_log(pose: FloatArray) -> FloatArray:
    """Return the SE(3) logarithm (..., 6) of (..., 4, 4) transforms: rotation in rad, then translation part in m.

    The inverse of the exponential map, for rotations below pi (Barfoot 2017, State Estimation for Robotics, section
    7.1.3). GTSAM's ``Pose3.Logmap`` has the same order; ``a.localCoordinates(b)`` is ``pose_log(invert(a) @ b)``.
    """
    from scipy.spatial.transform import Rotation

    matrices = pose[..., :3, :3].reshape(-1, 3, 3)
    rotation_rad = Rotation.from_matrix(matrices).as_rotvec().reshape(*pose.shape[:-2], 3)
    angle_rad = np.linalg.norm(rotation_rad, axis=-1, keepdims=True)
    safe_rad = np.maximum(angle_rad, 1e-4)  # below, the limit 1/12 is exact in double precision
    factor = (1 - safe_rad / 2 / np.tan(safe_rad / 2)) / safe_rad**2
    factor = np.where(angle_rad < 1e-4, 1 / 12, factor)
    turned_m = np.cross(rotation_rad, pose[..., :3, 3])
    translation_m = pose[..., :3, 3] - turned_m / 2 + factor * np.cross(rotation_rad, turned_m)
    return np.concatenate([rotation_rad, translation_m], axis=-1)
