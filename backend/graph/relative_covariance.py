"""How surely a bundle knows where one frame's sonar is from another's: marginal covariances of far-apart poses.

GTSAM's joint marginals of two poses a thousand steps apart take long, and there are many pairs. The points are
therefore eliminated by hand (Schur complement), and the sparse information of the poses is solved for the few frames
that are asked for.
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
    """Standard deviations with which a frame predicts where another one's points are seen, each (F, F)."""

    range_m: FloatArray
    bearing_rad: FloatArray
    elevation_rad: FloatArray


def joint_covariance(bundle: Bundle, frames: IntArray) -> FloatArray:
    """Give the covariance of some poses, with each other: (F, F, 6, 6), rotation and translation in their frames.

    Args:
        bundle: an optimum; what its graph holds of other things than poses and points is eliminated as well.
        frames: (F,) indices.
    """
    information = marginalise_points(bundle)
    columns = (information.first_column[frames][:, None] + np.arange(6)).ravel()
    unit = np.zeros((information.poses.shape[0], len(columns)))
    unit[columns, np.arange(len(columns))] = 1.0
    solved = splu(information.poses).solve(unit)[columns]
    return np.asarray(solved.reshape(len(frames), 6, len(frames), 6).transpose(0, 2, 1, 3))


def predict_sigma(
    covariance: FloatArray, world_from_vehicle: FloatArray, vehicle_from_sonar: FloatArray, reach_m: float
) -> RelativeSigma:
    """Tell how surely each frame predicts where the others see a point ahead of it.

    A point p that stands still moves in frame a by -(w x p + v) when that pose is disturbed by a turn w and a shift v.

    Args:
        covariance: (F, F, 6, 6) of :func:`joint_covariance`.
        world_from_vehicle: (F, 4, 4).
        vehicle_from_sonar: (4, 4).
        reach_m: how far ahead of the sonar the point lies.
    """
    ahead = transform(vehicle_from_sonar, np.array([reach_m, 0.0, 0.0]))
    in_world = transform(world_from_vehicle, ahead)
    in_vehicle = transform(invert(world_from_vehicle)[None, :], in_world[:, None])  # (a, b, 3): a's point seen from b
    turned = world_from_vehicle[:, :3, :3]
    of_a = np.einsum("aij,ajk->aik", turned, _disturb(np.broadcast_to(ahead, in_world.shape)))
    of_b = np.einsum("bij,abjk->abik", turned, _disturb(in_vehicle))
    diagonal = covariance[np.arange(len(turned)), np.arange(len(turned))]
    both = np.einsum("aik,akl,ajl->aij", of_a, diagonal, of_a)[:, None]
    both = both + np.einsum("abik,bkl,abjl->abij", of_b, diagonal, of_b, optimize=True)
    cross = np.einsum("aik,abkl,abjl->abij", of_a, covariance, of_b, optimize=True)
    both = both - cross - np.swapaxes(cross, -1, -2)
    seen = transform(invert(vehicle_from_sonar), in_vehicle)
    axes = np.einsum("bij,abjk->abik", turned @ vehicle_from_sonar[:3, :3], _image_axes(seen))
    sigma = np.sqrt(np.maximum(np.einsum("abik,abij,abjk->abk", axes, both, axes, optimize=True), 0))
    range_m = np.maximum(project(seen)[0], 1e-9)
    return RelativeSigma(sigma[..., 0], sigma[..., 1] / range_m, sigma[..., 2] / range_m)


def _disturb(xyz_m: FloatArray) -> FloatArray:
    """Differentiate where points of a frame are in the world's directions by its pose: (..., 3, 6), turn and shift."""
    x, y, z = np.moveaxis(xyz_m, -1, 0)
    zero, one = np.zeros_like(x), np.ones_like(x)
    rows = [
        np.stack([zero, z, -y, one, zero, zero], axis=-1),
        np.stack([-z, zero, x, zero, one, zero], axis=-1),
        np.stack([y, -x, zero, zero, zero, one], axis=-1),
    ]
    return np.stack(rows, axis=-2)


def _image_axes(xyz_m: FloatArray) -> FloatArray:
    """Give the directions of growing range, bearing and elevation at points of the sonar frame: (..., 3, 3) columns."""
    _, bearing_rad, elevation_rad = project(xyz_m)
    cb, sb, ce, se = np.cos(bearing_rad), np.sin(bearing_rad), np.cos(elevation_rad), np.sin(elevation_rad)
    zero = np.zeros_like(cb)
    columns = [[ce * cb, ce * sb, se], [-sb, cb, zero], [-se * cb, -se * sb, ce]]
    return np.stack([np.stack(column, axis=-1) for column in columns], axis=-1)
