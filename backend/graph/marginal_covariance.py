"""Marginal covariances of poses, relative motions and points at the optimum of a factor graph."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import SuperLU, splu

from asfm.backend.graph.bundle_adjustment import Bundle
from asfm.backend.graph.schur_complement import PoseInformation, marginalise_points, point_information
from asfm.geometry.poses import adjoint, invert
from asfm.types import FloatArray, IntArray

FRAMES_PER_BLOCK = 64
"""Columns of the covariance are computed for this many frames at a time, to bound memory."""


@dataclass(frozen=True)
class Uncertainty:
    """Marginal covariances at the optimum of a bundle."""

    pose: FloatArray
    """(N, 6, 6) rotation in rad and translation in m, in the vehicle frame."""
    span: FloatArray
    """(N - S, 6, 6) of the motion from each frame to the one S later, in the later vehicle frame."""
    point_m2: FloatArray
    """(T, 3, 3) in the world frame; infinite where the track has no factor."""


def measure_uncertainty(
    bundle: Bundle,
    elevation_information_ratio: FloatArray,
    span: int = 1,
    information: PoseInformation | None = None,
) -> Uncertainty:
    """Compute marginal covariances by inverting the information of the poses, a block of frames at a time.

    With point information H_pp and gain G = d(point)/d(pose), a point has the covariance H_pp^-1 + G C G', where C is
    that of the poses (block inversion by the Schur complement). H_pp is scaled first: the sigmas of a track's
    observations are widened for errors that they have in common, but such errors hardly affect the elevation, which
    follows from changes of range and bearing.

    Args:
        bundle: optimum of N poses and T points.
        elevation_information_ratio: (T,) ratio of the information that a track's observations have on its point to
            that stated in the graph.
        span: S, distance in frames of the poses whose relative motion is evaluated.
        information: that of the bundle, where it is known already.
    """
    information = information or marginalise_points(bundle)
    columns = information.first_column[:, None] + np.arange(6)
    factor, count = splu(information.poses), len(columns)
    pose, cross = np.empty((count, 6, 6)), np.empty((max(count - span, 0), 6, 6))
    from_poses = np.zeros_like(information.points)
    for frames in _frame_blocks(count):
        solved = _solve_columns(factor, columns[frames].ravel(), information)
        blocks = solved.reshape(len(solved), len(frames), 6)
        here = np.arange(len(frames))[:, None]
        pose[frames] = blocks[columns[frames], here]
        before = frames < count - span
        cross[frames[before]] = blocks[columns[frames[before] + span], here[before]]
        from_poses += _propagate_pose_covariance(information, solved, columns[frames].ravel())
    others = np.setdiff1d(np.arange(information.poses.shape[0]), columns)
    if len(others):
        solved = _solve_columns(factor, others, information)
        from_poses += _propagate_pose_covariance(information, solved, others)
    point = np.full((len(bundle.xyz_m), 3, 3), np.inf)
    measured = point_information(bundle.measured, bundle.values, information.track)
    own = information.points + (elevation_information_ratio[information.track, None, None] - 1) * measured
    point[information.track] = np.linalg.inv(own) + (from_poses + np.swapaxes(from_poses, 1, 2)) / 2
    return Uncertainty(pose, _relative_motion_covariance(pose, cross, bundle.world_from_vehicle, span), point)


def _frame_blocks(count: int) -> list[IntArray]:
    """Split the frames into blocks of indices."""
    return [np.arange(first, min(first + FRAMES_PER_BLOCK, count)) for first in range(0, count, FRAMES_PER_BLOCK)]


def _solve_columns(factor: SuperLU, columns: IntArray, information: PoseInformation) -> FloatArray:
    """Compute K columns of the covariance of the poses: (C, K)."""
    unit = np.zeros((information.poses.shape[0], len(columns)))
    unit[columns, np.arange(len(columns))] = 1.0
    return np.asarray(factor.solve(unit))


def _propagate_pose_covariance(information: PoseInformation, solved: FloatArray, columns: IntArray) -> FloatArray:
    """Compute the part of G C G' that K columns of the poses' covariance C, (C, K), contribute: (P, 3, 3)."""
    gain_times_columns = (information.point_pose_gain @ solved).reshape(-1, 3, len(columns))
    gain = information.point_pose_gain[:, columns].tocsr()
    product = np.empty_like(information.points)
    for axis in range(3):
        gain_of_axis = gain[axis::3]
        for other in range(3):
            terms = gain_of_axis.multiply(gain_times_columns[:, other])
            product[:, other, axis] = np.asarray(terms.sum(axis=1)).ravel()
    return product


def _relative_motion_covariance(
    pose: FloatArray, cross: FloatArray, world_from_vehicle: FloatArray, span: int
) -> FloatArray:
    """Compute the covariance of the motion from each pose to the one a span later, in the later vehicle frame.

    Args:
        pose: (N, 6, 6) covariance of each pose.
        cross: (N - S, 6, 6) cross-covariance of the later pose (rows) with the earlier one (columns).
        world_from_vehicle: (N, 4, 4) poses.
        span: S, in frames.

    Returns:
        (N - S, 6, 6)
    """
    first = pose[: len(cross)]
    change = adjoint(invert(world_from_vehicle[span:]) @ world_from_vehicle[: len(cross)])
    transposed = np.swapaxes(change, 1, 2)
    mixed = cross @ transposed
    motion = pose[span:] + change @ first @ transposed - mixed - np.swapaxes(mixed, 1, 2)
    return np.asarray((motion + np.swapaxes(motion, 1, 2)) / 2)
