"""Typical size of the steps from frame to frame, over a whole recording and near each step, for the motion prior."""

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import steps_between
from asfm.types import BoolArray, FloatArray

NEAR_STEPS = 5
"""Steps to each side over which the size of the motion is local."""


def typical_steps(world_from_vehicle: FloatArray, supported: BoolArray) -> FloatArray:
    """Return the (N - 1, 2) size of a typical rotation in rad and translation in m, each axis, at every step.

    It is the root mean square over the (N - 1,) supported steps, or over those near the step where that is larger: a
    short manoeuvre must not be held by the slow motion before and after it.
    """
    steps = steps_between(world_from_vehicle)
    rotation_rad = Rotation.from_matrix(steps[:, :3, :3]).as_rotvec()
    squares = np.stack([np.mean(rotation_rad**2, axis=1), np.mean(steps[:, :3, 3] ** 2, axis=1)], axis=1)
    squares[~supported] = 0.0
    share = _mean_near(supported.astype(float)[:, None])
    local = np.divide(_mean_near(squares), share, out=np.zeros_like(squares), where=share > 0.5 / (2 * NEAR_STEPS + 1))
    return np.asarray(np.sqrt(np.maximum(local, squares.sum(axis=0) / max(np.count_nonzero(supported), 1))))


def _mean_near(values: FloatArray) -> FloatArray:
    """Return the (S, C) means over the steps near each, zero where there are none."""
    return np.asarray(uniform_filter1d(values, 2 * NEAR_STEPS + 1, axis=0, mode="constant"))
