"""How sure a bundle is: covariances of the poses, of the steps between them, and of the points."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import SuperLU, splu

from asfm.backend.graph.bundle_adjustment import Bundle
from asfm.backend.graph.schur_complement import PoseInformation, marginalise_points, point_information
from asfm.geometry.poses import invert
from asfm.types import FloatArray, IntArray

FRAMES_AT_ONCE = 64


@dataclass(frozen=True)
class Uncertainty:
    """Marginal covariances at the optimum of a bundle."""

    pose: FloatArray
    """(N, 6, 6) rotation in rad and translation in m, in the vehicle's frame."""
    span: FloatArray
    """(N - S, 6, 6) of the motion from each frame to the one S later, in the later vehicle's frame."""
    point_m2: FloatArray
    """(T, 3, 3) in the world frame; infinite where the track has no factor."""


def measure_uncertainty(bundle: Bundle, elevation_information_ratio: FloatArray, span: int = 1) -> Uncertainty:
    """Invert the information of a bundle, block by block of frames.

    What a point owes to the poses follows exactly from theirs. What it owes to its own observations is told apart
    because their sigmas are widened for errors that a track's observations have in common. Such errors hardly tilt the
    elevation, which follows from how range and bearing change: the points' own information is larger than the graph
    states, by a ratio.

    Args:
        bundle: an optimum.
        elevation_information_ratio: (T,) by how much each point's own information is larger than the graph states.
        span: S, how many frames apart the poses are whose relative motion is looked at.
    """
    information = marginalise_points(bundle)
    columns = information.first_column[:, None] + np.arange(6)
    factor, count = splu(information.poses), len(columns)
    pose, beside = np.empty((count, 6, 6)), np.empty((max(count - span, 0), 6, 6))
    carried = np.zeros_like(information.points)
    for frames in _chunks(count):
        solved = _solve_columns(factor, columns[frames].ravel(), information)
        blocks = solved.reshape(len(solved), len(frames), 6)
        here = np.arange(len(frames))[:, None]
        pose[frames] = blocks[columns[frames], here]
        before = frames < count - span
        beside[frames[before]] = blocks[columns[frames[before] + span], here[before]]
        carried += _carry(information, solved, columns[frames].ravel())
    others = np.setdiff1d(np.arange(information.poses.shape[0]), columns)
    if len(others):
        carried += _carry(information, _solve_columns(factor, others, information), others)
    point = np.full((len(bundle.xyz_m), 3, 3), np.inf)
    measured = point_information(bundle.measured, bundle.values, information.track)
    own = information.points + (elevation_information_ratio[information.track, None, None] - 1) * measured
    point[information.track] = np.linalg.inv(own) + (carried + np.swapaxes(carried, 1, 2)) / 2
    return Uncertainty(pose, _relate(pose, beside, bundle.world_from_vehicle, span), point)


def _chunks(count: int) -> list[IntArray]:
    """Cut the frames into runs, to bound memory."""
    return [np.arange(first, min(first + FRAMES_AT_ONCE, count)) for first in range(0, count, FRAMES_AT_ONCE)]


def _solve_columns(factor: SuperLU, columns: IntArray, information: PoseInformation) -> FloatArray:
    """Give some columns of the covariance of the poses: (C, K)."""
    unit = np.zeros((information.poses.shape[0], len(columns)))
    unit[columns, np.arange(len(columns))] = 1.0
    return np.asarray(factor.solve(unit))


def _carry(information: PoseInformation, solved: FloatArray, columns: IntArray) -> FloatArray:
    """Give the share of some columns of the poses' covariance in what the points owe to the poses: (P, 3, 3)."""
    moved = (information.point_pose_gain @ solved).reshape(-1, 3, len(columns))
    point_pose_gain = information.point_pose_gain[:, columns].tocsr()
    share = np.empty_like(information.points)
    for axis in range(3):
        of_axis = point_pose_gain[axis::3]
        for other in range(3):
            share[:, other, axis] = np.asarray(of_axis.multiply(moved[:, other]).sum(axis=1)).ravel()
    return share


def _relate(pose: FloatArray, beside: FloatArray, world_from_vehicle: FloatArray, span: int) -> FloatArray:
    """Give the covariance of the motion from each pose to the one a span later, in the latter's frame: (N - S, 6, 6).

    Args:
        pose: (N, 6, 6)
        beside: (N - S, 6, 6) of each pose (columns) with the one a span later (rows).
    """
    first = pose[: len(beside)]
    carry = _adjoint(invert(world_from_vehicle[span:]) @ world_from_vehicle[: len(beside)])
    turned = np.swapaxes(carry, 1, 2)
    mixed = beside @ turned
    motion = pose[span:] + carry @ first @ turned - mixed - np.swapaxes(mixed, 1, 2)
    return np.asarray((motion + np.swapaxes(motion, 1, 2)) / 2)


def _adjoint(pose: FloatArray) -> FloatArray:
    """Carry turns and shifts of one frame into another: (..., 6, 6) of (..., 4, 4)."""
    rotation, (x, y, z) = pose[..., :3, :3], np.moveaxis(pose[..., :3, 3], -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*zero.shape, 3, 3)
    carried = np.zeros((*zero.shape, 6, 6))
    carried[..., :3, :3] = carried[..., 3:, 3:] = rotation
    carried[..., 3:, :3] = cross @ rotation
    return carried
