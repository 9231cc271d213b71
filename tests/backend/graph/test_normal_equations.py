"""Normal equations: elimination of the points gives the step of the whole system."""

import gtsam
import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from asfm.backend.graph.normal_equations import MIN_CURVATURE, NormalEquations, move_poses
from asfm.geometry.poses import make_pose
from asfm.types import FloatArray


def make_system(seed: int) -> tuple[NormalEquations, FloatArray]:
    """Return normal equations of two poses and four points, and their whole matrix."""
    rng = np.random.default_rng(seed)
    jacobian = rng.normal(size=(60, 24))
    of_point = np.repeat(np.arange(4), 15)
    for point in range(4):  # each row measures one point
        jacobian[of_point != point, 12 + 3 * point : 15 + 3 * point] = 0
    matrix = jacobian.T @ jacobian
    points = np.stack([matrix[i : i + 3, i : i + 3] for i in range(12, 24, 3)])
    return NormalEquations(rng.normal(size=24), matrix[:12, :12], matrix[:12, 12:], points), matrix


def test_step_is_that_of_the_whole_system() -> None:
    system, matrix = make_system(0)
    motion, shift = system.solve(0.0)
    expected = -np.linalg.solve(matrix, system.gradient)
    np.testing.assert_allclose(np.concatenate([motion.ravel(), shift.ravel()]), expected, rtol=1e-9, atol=1e-12)


def test_damping_adds_to_the_diagonal_and_to_the_points() -> None:
    system, matrix = make_system(1)
    trust = np.stack([(k + 1) * np.diag([1.0, 2.0, 3.0]) for k in range(4)])
    motion, shift = system.solve(0.3, trust)
    damped = matrix + np.diag(0.3 * (np.diag(matrix) + MIN_CURVATURE)) + block_diag(np.zeros((12, 12)), *trust)
    expected = -np.linalg.solve(damped, system.gradient)
    np.testing.assert_allclose(np.concatenate([motion.ravel(), shift.ravel()]), expected, rtol=1e-9, atol=1e-12)


def test_poses_move_in_their_own_frames() -> None:
    rng = np.random.default_rng(2)
    poses = make_pose(rng.normal(size=(3, 3)), Rotation.random(3, random_state=3))
    motion = np.column_stack([rng.normal(size=(3, 3)), np.zeros((3, 3))])
    turns = [gtsam.Pose3.Expmap(row) for row in motion]
    expected = [gtsam.Pose3(pose).compose(turn).matrix() for pose, turn in zip(poses, turns, strict=True)]
    np.testing.assert_allclose(move_poses(poses, motion), expected, atol=1e-12)
    shifted = move_poses(poses, np.column_stack([np.zeros((3, 3)), rng.normal(size=(3, 3))]))
    np.testing.assert_allclose(shifted[:, :3, :3], poses[:, :3, :3], atol=1e-12)
