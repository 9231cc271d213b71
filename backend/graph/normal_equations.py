"""Normal equations of poses and points, solved with the points eliminated (Schur complement), in dense arrays."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from asfm.types import FloatArray, IntArray

MIN_CURVATURE = 1e-3
"""Added to the diagonal before it is damped, so that unobserved directions do not move."""


@dataclass(frozen=True)
class NormalEquations:
    """Gradient and Gauss-Newton matrix of a cost of N poses and T points; no term joins two points."""

    gradient: FloatArray
    """(6 N + 3 T,) of poses, then points."""
    poses: FloatArray
    """(6 N, 6 N)"""
    mixed: FloatArray
    """(6 N, 3 T)"""
    points: FloatArray
    """(T, 3, 3)"""

    def solve(self, damping: float, point_damping: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """Solve for the step of the poses and of the points.

        Args:
            damping: share of the diagonal that is added to it (Marquardt).
            point_damping: (T, 3, 3) added to the points' matrices.

        Returns:
            (N, 6) rotation and translation in each pose's own frame, (T, 3) shift of the points.

        Raises:
            LinAlgError: the damped equations are singular.
        """
        count = len(self.poses)
        diagonal = np.einsum("tii->ti", self.points)
        damped = self.points + damping * np.eye(3) * (diagonal + MIN_CURVATURE)[:, None]
        inverse = np.linalg.inv(damped if point_damping is None else damped + point_damping)
        by_track = self.mixed.reshape(count, -1, 3).swapaxes(0, 1)
        gain = (by_track @ inverse).swapaxes(0, 1).reshape(count, -1)
        reduced = self.poses - gain @ self.mixed.T
        reduced[np.diag_indices(count)] += damping * (np.diag(self.poses) + MIN_CURVATURE)
        by_pose, by_point = self.gradient[:count], self.gradient[count:]
        motion = -cho_solve(cho_factor(reduced, check_finite=False), by_pose - gain @ by_point)
        shift = -np.einsum("tij,tj->ti", inverse, (by_point + self.mixed.T @ motion).reshape(-1, 3))
        return motion.reshape(-1, 6), shift


def move_poses(poses: FloatArray, motion: FloatArray) -> FloatArray:
    """Return the (N, 4, 4) poses moved by (N, 6) rotations and translations in their own frames."""
    moved = poses.copy()
    moved[:, :3, 3] += np.einsum("nij,nj->ni", poses[:, :3, :3], motion[:, 3:])
    moved[:, :3, :3] = poses[:, :3, :3] @ Rotation.from_rotvec(motion[:, :3]).as_matrix()
    return moved


def summation_matrix(group: IntArray, count: int) -> csr_array:
    """Return the (G, M) matrix that sums values by their (M,) group."""
    return csr_array((np.ones(len(group)), (group, np.arange(len(group)))), shape=(count, len(group)))
