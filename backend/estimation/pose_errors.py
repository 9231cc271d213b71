"""What the errors of the poses add to the residuals: all tracks of a frame share it."""

import numpy as np

from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import project_jacobian
from asfm.types import BoolArray, FloatArray, Tracks

LEAST_SHARE = 1e-9
"""PoseInformation that every direction of a pose is said to hold at least, over the sum of all."""


def remove_pose_errors(
    tracks: Tracks,
    observed: BoolArray,
    residual: FloatArray,
    sigma: FloatArray,
    xyz_m: FloatArray,
    world_from_sonar: FloatArray,
) -> FloatArray:
    """Take out of each frame's residuals what a small motion of its sonar explains: one linear fit a frame.

    Args:
        tracks: (O,) observations.
        observed: (O,) which of them count; the residuals of the others stay.
        residual: (O, 2) whitened residuals of range and bearing.
        sigma: (O, 2) standard deviations that whitened them, m and rad.
        xyz_m: (T, 3) points, world frame.
        world_from_sonar: (N, 4, 4) poses.

    Returns:
        (O, 2) residuals that no pose of their frame explains.
    """
    frame = tracks.frame[observed]
    seen = transform(invert(world_from_sonar)[frame], xyz_m[tracks.track[observed]])
    shift = project_jacobian(seen)[:, :2]
    slopes = np.concatenate([shift @ _cross(seen), shift], axis=2) / sigma[observed][..., None]
    information, gradient = np.zeros((len(world_from_sonar), 6, 6)), np.zeros((len(world_from_sonar), 6))
    np.add.at(information, frame, np.einsum("oki,okj->oij", slopes, slopes))
    np.add.at(gradient, frame, np.einsum("oki,ok->oi", slopes, residual[observed]))
    trace = np.trace(information, axis1=1, axis2=2)
    information += np.maximum(LEAST_SHARE * trace, np.finfo(float).tiny)[:, None, None] * np.eye(6)
    motion = np.linalg.solve(information, gradient[..., None])[..., 0]
    left = residual.copy()
    left[observed] -= np.einsum("oki,oi->ok", slopes, motion[frame])
    return left


def _cross(xyz_m: FloatArray) -> FloatArray:
    """Give the matrices (O, 3, 3) by which small turns move points (O, 3)."""
    x, y, z = xyz_m.T
    zero = np.zeros_like(x)
    return np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=1).reshape(-1, 3, 3)
