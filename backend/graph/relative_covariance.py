"""Joint marginal covariance of selected poses, and the image uncertainty between them.

GTSAM's joint marginals are slow for poses a thousand steps apart, and there are many pairs. The points are therefore
marginalised by the Schur complement, and the sparse information of the poses is solved for the selected frames.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import splu

from asfm.backend.graph.bundle_adjustment import Bundle
from asfm.backend.graph.schur_complement import marginalise_points
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import project
from asfm.types import FloatArray, IntArray


@dataclass(frozen=True)
class RelativeSigma:
    """Standard deviations of a point ahead of frame a (rows) as predicted in frame b (columns), each (F, F)."""

    range_m: FloatArray
    bearing_rad: FloatArray
    elevation_rad: FloatArray


def joint_covariance(bundle: Bundle, frames: IntArray) -> FloatArray:
    """Compute the joint covariance of selected poses.

    Args:
        bundle: optimum; all other variables of its graph are marginalised out.
        frames: (F,) indices of the frames.

    Returns:
        (F, F, 6, 6) blocks; rotation in rad and translation in m, in the frame of each vehicle.
    """
    information = marginalise_points(bundle)
    columns = (information.first_column[frames][:, None] + np.arange(6)).ravel()
    unit = np.zeros((information.poses.shape[0], len(columns)))
    unit[columns, np.arange(len(columns))] = 1.0
    solved = splu(information.poses).solve(unit)[columns]
    return np.asarray(solved.reshape(len(frames), 6, len(frames), 6).transpose(0, 2, 1, 3))


def predict_sigma(
    covariance: FloatArray, world_from_vehicle: FloatArray, vehicle_from_sonar: FloatArray, distance_m: float
) -> RelativeSigma:
    """Predict how uncertain a point ahead of each frame is in the images of the others.

    Disturbing the pose of a frame by a rotation w and a translation v moves a fixed point p in that frame by
    -(w x p + v).

    Args:
        covariance: (F, F, 6, 6) of :func:`joint_covariance`.
        world_from_vehicle: (F, 4, 4) poses.
        vehicle_from_sonar: (4, 4) lever arm.
        distance_m: distance of the point from the sonar, straight ahead.
    """
    ahead = transform(vehicle_from_sonar, np.array([distance_m, 0.0, 0.0]))
    in_world = transform(world_from_vehicle, ahead)
    in_vehicle = transform(invert(world_from_vehicle)[None, :], in_world[:, None])  # (a, b, 3): a's point seen from b
    rotation = world_from_vehicle[:, :3, :3]
    of_a = np.einsum("aij,ajk->aik", rotation, _point_jacobian(np.broadcast_to(ahead, in_world.shape)))
    of_b = np.einsum("bij,abjk->abik", rotation, _point_jacobian(in_vehicle))
    diagonal = covariance[np.arange(len(rotation)), np.arange(len(rotation))]
    both = np.einsum("aik,akl,ajl->aij", of_a, diagonal, of_a)[:, None]
    both = both + np.einsum("abik,bkl,abjl->abij", of_b, diagonal, of_b, optimize=True)
    cross = np.einsum("aik,abkl,abjl->abij", of_a, covariance, of_b, optimize=True)
    both = both - cross - np.swapaxes(cross, -1, -2)
    seen = transform(invert(vehicle_from_sonar), in_vehicle)
    axes = np.einsum("bij,abjk->abik", rotation @ vehicle_from_sonar[:3, :3], _image_axes(seen))
    sigma = np.sqrt(np.maximum(np.einsum("abik,abij,abjk->abk", axes, both, axes, optimize=True), 0))
    range_m = np.maximum(project(seen)[0], 1e-9)
    return RelativeSigma(sigma[..., 0], sigma[..., 1] / range_m, sigma[..., 2] / range_m)


def _point_jacobian(xyz_m: FloatArray) -> FloatArray:
    """Differentiate (..., 3) points fixed in a vehicle by its pose, rotation and translation: (..., 3, 6)."""
    x, y, z = np.moveaxis(xyz_m, -1, 0)
    zero, one = np.zeros_like(x), np.ones_like(x)
    rows = [
        np.stack([zero, z, -y, one, zero, zero], axis=-1),
        np.stack([-z, zero, x, zero, one, zero], axis=-1),
        np.stack([y, -x, zero, zero, zero, one], axis=-1),
    ]
    return np.stack(rows, axis=-2)


def _image_axes(xyz_m: FloatArray) -> FloatArray:
    """Compute the unit vectors of range, bearing and elevation at (..., 3) points: (..., 3, 3), one a column."""
    _, bearing_rad, elevation_rad = project(xyz_m)
    cb, sb, ce, se = np.cos(bearing_rad), np.sin(bearing_rad), np.cos(elevation_rad), np.sin(elevation_rad)
    zero = np.zeros_like(cb)
    columns = [[ce * cb, ce * sb, se], [-sb, cb, zero], [-se * cb, -se * sb, ce]]
    return np.stack([np.stack(column, axis=-1) for column in columns], axis=-1)
