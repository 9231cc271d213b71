"""Rigid transforms as stacks of 4 x 4 matrices, and their text form in TUM order (x y z qx qy qz qw)."""

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from asfm.types import FloatArray


def make_pose(translation_m: FloatArray, rotation: Rotation) -> FloatArray:
    """Assemble (..., 4, 4) transforms from (..., 3) translations and a rotation (a stack of as many)."""
    translation_m = np.asarray(translation_m, dtype=float)
    pose = np.zeros((*translation_m.shape[:-1], 4, 4))
    pose[..., :3, :3] = rotation.as_matrix()
    pose[..., :3, 3] = translation_m
    pose[..., 3, 3] = 1.0
    return pose


def pose_from_tum(row: FloatArray) -> FloatArray:
    """Turn (..., 7) rows x y z qx qy qz qw into (..., 4, 4) transforms; quaternions are normalised."""
    row = np.asarray(row, dtype=float)
    return make_pose(row[..., :3], Rotation.from_quat(row[..., 3:]))


def tum_from_pose(pose: FloatArray) -> FloatArray:
    """Turn (..., 4, 4) transforms into (..., 7) rows x y z qx qy qz qw with qw >= 0."""
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
    if len(timestamps_s) == 1:
        return np.repeat(pose, len(at_s), axis=0)
    at_s = np.clip(at_s, timestamps_s[0], timestamps_s[-1])
    translation_m = np.stack([np.interp(at_s, timestamps_s, pose[:, axis, 3]) for axis in range(3)], axis=-1)
    return make_pose(translation_m, Slerp(timestamps_s, Rotation.from_matrix(pose[:, :3, :3]))(at_s))
