"""What a bundle's graph knows of the poses once the points are eliminated, and how the points follow the poses."""

from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix

from asfm.backend.graph.bundle_adjustment import Bundle
from asfm.backend.graph.problem import FIRST_POINT, FIRST_POSE
from asfm.types import FloatArray, IntArray

LEAST_SHARE = 1e-9
"""PoseInformation that every direction is said to hold at least, over the typical one: still sonars leave some open."""


@dataclass(frozen=True)
class PoseInformation:
    """The information matrix of a graph at its optimum, points eliminated (Schur complement)."""

    poses: csc_matrix
    """(C, C) of the poses, and of whatever else is no point."""
    first_column: IntArray
    """(N,) where each pose's six columns begin: rotation and translation in its own frame."""
    track: IntArray
    """(P,) the tracks that have a point in the graph, in order."""
    points: FloatArray
    """(P, 3, 3) each point's own information when the poses are known."""
    point_pose_gain: csr_matrix
    """(3 P, C) how the points move when the poses do: minus the points' information's inverse times the mixed one."""


def marginalise_points(bundle: Bundle) -> PoseInformation:
    """Linearise the graph at its optimum and eliminate the points: no two of them share a factor."""
    jacobian, keys, start = _linearise(bundle.graph, bundle.values)
    is_point = (keys >= FIRST_POINT) & (keys < FIRST_POINT + len(bundle.xyz_m))
    of_points = np.repeat(is_point, np.diff(start))
    points, others = jacobian[:, of_points], jacobian[:, ~of_points]
    information = (others.T @ others).tocsc()
    own = _take_blocks((points.T @ points).tocsr())
    mixed = (points.T @ others).tocsr()
    point_pose_gain = -(_lay_blocks(np.asarray(np.linalg.inv(own), dtype=float)) @ mixed)
    information = information + mixed.T @ point_pose_gain
    floor = np.full(information.shape[0], LEAST_SHARE * np.median(information.diagonal()))
    information = (information + coo_matrix((floor, (np.arange(len(floor)),) * 2), shape=information.shape)).tocsc()
    first = start[np.searchsorted(keys, FIRST_POSE + np.arange(len(bundle.world_from_vehicle)))]
    before = np.concatenate([[0], np.cumsum(of_points)])
    track = np.asarray(keys[is_point] - FIRST_POINT, dtype=np.int64)
    return PoseInformation(
        information, np.asarray(first - before[first], dtype=np.int64), track, own, point_pose_gain.tocsr()
    )


def point_information(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, track: IntArray) -> FloatArray:
    """Give what a graph alone knows of the points of some tracks when the poses are known: (P, 3, 3)."""
    jacobian, keys, start = _linearise(graph, values)
    column = start[np.searchsorted(keys, FIRST_POINT + track)]
    points = jacobian[:, (column[:, None] + np.arange(3)).ravel()]
    return _take_blocks((points.T @ points).tocsr(), 0.0)


def _linearise(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> tuple[csc_matrix, IntArray, IntArray]:
    """Give the whitened Jacobian, its (K,) sorted keys, and where the columns of each begin, (K + 1,)."""
    linear = graph.linearize(values)
    row, column, value = linear.sparseJacobian_()
    keys = np.array(sorted(linear.keyVector()), dtype=np.int64)
    zero = values.zeroVectors()
    start = np.concatenate([[0], np.cumsum([len(zero.at(int(key))) for key in keys])])
    inside = column <= start[-1]  # the last column is the right-hand side
    where = (row[inside].astype(np.int64) - 1, column[inside].astype(np.int64) - 1)
    return coo_matrix((value[inside], where), shape=(int(row.max()), int(start[-1]))).tocsc(), keys, start


def _take_blocks(information: csr_matrix, share: float = LEAST_SHARE) -> FloatArray:
    """Take the (P, 3, 3) blocks on the diagonal, each with a little added that it can be inverted."""
    if not information.shape[0]:
        return np.zeros((0, 3, 3))
    rows, columns = _number_blocks(information.shape[0] // 3)
    blocks = np.asarray(information[rows, columns]).reshape(-1, 3, 3)
    return np.asarray(blocks + share * np.trace(blocks, axis1=1, axis2=2)[:, None, None] * np.eye(3))


def _lay_blocks(blocks: FloatArray) -> csr_matrix:
    return coo_matrix((blocks.ravel(), _number_blocks(len(blocks))), shape=(3 * len(blocks),) * 2).tocsr()


def _number_blocks(count: int) -> tuple[IntArray, IntArray]:
    """Number the rows and columns of the 3 x 3 blocks on a diagonal, (9 P,) each."""
    corner = 3 * np.arange(count)[:, None, None]
    rows, columns = np.broadcast_arrays(corner + np.arange(3)[:, None], corner + np.arange(3))
    return rows.ravel(), columns.ravel()
