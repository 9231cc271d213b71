"""Pose errors in residuals: the part that the observations of a frame have in common."""

import numpy as np

from asfm.geometry.poses import cross_matrix, invert, transform
from asfm.geometry.sonar import project_jacobian
from asfm.types import BoolArray, FloatArray, Tracks

MIN_INFORMATION_SHARE = 1e-9
"""Damping: smallest information of each direction of a pose, over the trace."""


def remove_pose_errors(
    tracks: Tracks,
    observed: BoolArray,
    residual: FloatArray,
    sigma: FloatArray,
    xyz_m: FloatArray,
    world_from_sonar: FloatArray,
) -> FloatArray:
    """Remove the part of each frame's residuals that a small motion of its sonar explains (linear least squares).

    Args:
        tracks: (O,) observations.
        observed: (O,) which observations are used; the residuals of the others stay.
        residual: (O, 2) whitened residuals of range and bearing.
        sigma: (O, 2) standard deviations of range_m and bearing_rad by which they were whitened.
        xyz_m: (T, 3) points, world frame.
        world_from_sonar: (N, 4, 4) poses.

    Returns:
        (O, 2) whitened residuals without the errors of the poses.
    """
    frame = tracks.frame[observed]
    in_sonar = transform(invert(world_from_sonar)[frame], xyz_m[tracks.track[observed]])
    by_point = project_jacobian(in_sonar)[:, :2]
    jacobian = np.concatenate([by_point @ -cross_matrix(in_sonar), by_point], axis=2) / sigma[observed][..., None]
    information, gradient = np.zeros((len(world_from_sonar), 6, 6)), np.zeros((len(world_from_sonar), 6))
    np.add.at(information, frame, np.einsum("oki,okj->oij", jacobian, jacobian))
    np.add.at(gradient, frame, np.einsum("oki,ok->oi", jacobian, residual[observed]))
    trace = np.trace(information, axis1=1, axis2=2)
    information += np.maximum(MIN_INFORMATION_SHARE * trace, np.finfo(float).tiny)[:, None, None] * np.eye(6)
    motion = np.linalg.solve(information, gradient[..., None])[..., 0]
    remaining = residual.copy()
    remaining[observed] -= np.einsum("oki,oi->ok", jacobian, motion[frame])
    return remaining
