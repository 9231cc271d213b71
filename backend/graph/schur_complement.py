"""Schur complement: information of the poses with the points marginalised out, and the point-pose gain."""

from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix

from asfm.backend.graph.bundle_adjustment import Bundle
from asfm.backend.graph.problem import FIRST_POINT, FIRST_POSE
from asfm.types import FloatArray, IntArray

MIN_RELATIVE_INFORMATION = 1e-9
"""Information added on the diagonal, relative to the typical one: a sonar at rest leaves directions unobserved, and the
matrices must be invertible."""


@dataclass(frozen=True)
class PoseInformation:
    """Information matrix of a graph at its optimum, with the points marginalised out."""

    poses: csc_matrix
    """(C, C) Schur complement: information of the poses, and of all other variables that are not points."""
    first_column: IntArray
    """(N,) first of the six columns of each pose: rotation and translation in its own frame."""
    track: IntArray
    """(P,) tracks that have a point in the graph, ascending."""
    points: FloatArray
    """(P, 3, 3) information of each point given the poses: the diagonal blocks H_pp."""
    point_pose_gain: csr_matrix
    """(3 P, C) gain d(point)/d(pose) = -H_pp^-1 H_px."""


def marginalise_points(bundle: Bundle) -> PoseInformation:
    """Linearise a graph at its optimum and marginalise the points out.

    With H_pp the information of the points, H_xx that of the rest and H_px the mixed one, the Schur complement is
    H_xx - H_xp H_pp^-1 H_px. H_pp is block diagonal because no factor connects two points.
    """
    jacobian, keys, start = _linearise(bundle.graph, bundle.values)
    is_point = (keys >= FIRST_POINT) & (keys < FIRST_POINT + len(bundle.xyz_m))
    of_points = np.repeat(is_point, np.diff(start))
    points, others = jacobian[:, of_points], jacobian[:, ~of_points]
    information = (others.T @ others).tocsc()
    own = _diagonal_blocks((points.T @ points).tocsr())
    mixed = (points.T @ others).tocsr()
    point_pose_gain = -(_block_diagonal(np.asarray(np.linalg.inv(own), dtype=float)) @ mixed)
    information = information + mixed.T @ point_pose_gain
    floor = np.full(information.shape[0], MIN_RELATIVE_INFORMATION * np.median(information.diagonal()))
    information = (information + coo_matrix((floor, (np.arange(len(floor)),) * 2), shape=information.shape)).tocsc()
    first = start[np.searchsorted(keys, FIRST_POSE + np.arange(len(bundle.world_from_vehicle)))]
    before = np.concatenate([[0], np.cumsum(of_points)])
    track = np.asarray(keys[is_point] - FIRST_POINT, dtype=np.int64)
    return PoseInformation(
        information, np.asarray(first - before[first], dtype=np.int64), track, own, point_pose_gain.tocsr()
    )


def point_information(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, track: IntArray) -> FloatArray:
    """Compute the information that a graph has on points given the poses.

    Args:
        graph: may be another graph than the one that the values are the optimum of.
        values: where it is linearised.
        track: (P,) tracks of the points; each must be a variable of the graph.

    Returns:
        (P, 3, 3)
    """
    jacobian, keys, start = _linearise(graph, values)
    column = start[np.searchsorted(keys, FIRST_POINT + track)]
    points = jacobian[:, (column[:, None] + np.arange(3)).ravel()]
    return _diagonal_blocks((points.T @ points).tocsr(), 0.0)


def _linearise(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> tuple[csc_matrix, IntArray, IntArray]:
    """Return the whitened Jacobian, its (K,) sorted keys, and the first column of each, (K + 1,) with the end."""
    linear = graph.linearize(values)
    row, column, value = linear.sparseJacobian_()
    keys = np.array(sorted(linear.keyVector()), dtype=np.int64)
    zero = values.zeroVectors()
    start = np.concatenate([[0], np.cumsum([len(zero.at(int(key))) for key in keys])])
    inside = column <= start[-1]  # the last column is the right-hand side
    where = (row[inside].astype(np.int64) - 1, column[inside].astype(np.int64) - 1)
    return coo_matrix((value[inside], where), shape=(int(row.max()), int(start[-1]))).tocsc(), keys, start


def _diagonal_blocks(information: csr_matrix, relative_floor: float = MIN_RELATIVE_INFORMATION) -> FloatArray:
    """Return the (P, 3, 3) diagonal blocks, each with a fraction of its trace added to the diagonal."""
    if not information.shape[0]:
        return np.zeros((0, 3, 3))
    rows, columns = _block_indices(information.shape[0] // 3)
    blocks = np.asarray(information[rows, columns]).reshape(-1, 3, 3)
    return np.asarray(blocks + relative_floor * np.trace(blocks, axis1=1, axis2=2)[:, None, None] * np.eye(3))


def _block_diagonal(blocks: FloatArray) -> csr_matrix:
    """Return the block-diagonal (3 P, 3 P) matrix of (P, 3, 3) blocks."""
    return coo_matrix((blocks.ravel(), _block_indices(len(blocks))), shape=(3 * len(blocks),) * 2).tocsr()


def _block_indices(count: int) -> tuple[IntArray, IntArray]:
    """Return the row and column indices of the 3 x 3 blocks on the diagonal, (9 P,) each."""
    corner = 3 * np.arange(count)[:, None, None]
    rows, columns = np.broadcast_arrays(corner + np.arange(3)[:, None], corner + np.arange(3))
    return rows.ravel(), columns.ravel()
