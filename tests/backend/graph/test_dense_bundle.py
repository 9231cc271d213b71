"""Dense bundle adjustment: the optimum is that of a general least-squares solver, and fixed poses stay."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from asfm.backend.graph.dense_bundle import adjust_dense
from asfm.backend.graph.dense_problem import DenseProblem, whiten
from asfm.backend.graph.normal_equations import move_poses
from asfm.geometry.poses import invert, make_pose, pose_log, steps_between, transform
from asfm.geometry.sonar import project
from asfm.types import FloatArray

FREE = np.array([False, True, True])


def make_problem(noise: float = 0.0) -> tuple[DenseProblem, FloatArray, FloatArray]:
    """Return a problem of three poses and twelve points, its true poses and its true points."""
    rng = np.random.default_rng(0)
    poses = make_pose(
        np.array([[0, 0, 0], [0.2, 0.1, 0.05], [0.3, -0.2, 0.15]]),
        Rotation.from_rotvec([[0, 0, 0], [0.15, -0.1, 0.05], [-0.2, 0.12, 0.1]]),
    )
    xyz_m = np.column_stack([rng.uniform(3, 5, 12), rng.uniform(-1.5, 1.5, 12), rng.uniform(-0.6, 0.6, 12)])
    frame, track = np.divmod(np.arange(36), 12)
    range_m, bearing_rad, _ = project(transform(invert(poses)[frame], xyz_m[track]))
    sigma = np.tile([0.01, 0.005], (36, 1))
    measured = np.stack([range_m, bearing_rad], axis=1) + noise * sigma * rng.normal(size=(36, 2))
    problem = DenseProblem(frame, track, measured, sigma, np.full((2, 2), [0.5, 1.0]), 0.3)
    return problem, poses, xyz_m


def disturb(poses: FloatArray, xyz_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(1)
    motion = 0.05 * rng.normal(size=(3, 6))
    motion[0] = 0
    return move_poses(poses, motion), xyz_m + 0.1 * rng.normal(size=xyz_m.shape)


def reference_cost(problem: DenseProblem, poses: FloatArray, xyz_m: FloatArray, start_m: FloatArray) -> float:
    """Find the lowest cost by SciPy, from the same start, with a numerical Jacobian."""

    def residuals(x: FloatArray) -> FloatArray:
        moved = poses.copy()
        moved[FREE] = move_poses(poses[FREE], x[:12].reshape(2, 6))
        points = xyz_m + x[12:].reshape(-1, 3)
        in_sonar = transform(invert(moved)[problem.frame], points[problem.track])
        views = np.bincount(problem.track)[problem.track]
        steps = pose_log(steps_between(moved)) / np.repeat(problem.step_sigma, 3, axis=1)
        elevation = project(in_sonar)[2] / (problem.elevation_sigma_rad * np.sqrt(views))
        near = (points - start_m) / problem.point_sigma_m
        return np.concatenate([whiten(problem, moved, points).ravel(), elevation, near.ravel(), steps.ravel()])

    return float(least_squares(residuals, np.zeros(12 + xyz_m.size), xtol=1e-12, ftol=1e-12).cost)


@pytest.mark.parametrize(
    ("elevation_sigma_rad", "point_sigma_m"),
    [(0.2, np.inf), (np.inf, 0.3), (0.1, 0.5)],
    ids=["elevation", "point", "both"],
)
def test_optimum_is_that_of_scipy(elevation_sigma_rad: float, point_sigma_m: float) -> None:
    problem, poses, xyz_m = make_problem(noise=1.0)
    problem = replace(problem, elevation_sigma_rad=elevation_sigma_rad, point_sigma_m=point_sigma_m)
    start = disturb(poses, xyz_m)
    found = adjust_dense(problem, *start, FREE, iterations=200, tolerance=1e-10)
    np.testing.assert_allclose(found.cost, reference_cost(problem, *start, start[1]), rtol=1e-5)


def test_exact_observations_are_met_and_fixed_poses_stay() -> None:
    problem, poses, xyz_m = make_problem()
    problem = replace(problem, step_sigma=np.full((2, 2), np.inf))
    start = disturb(poses, xyz_m)
    found = adjust_dense(problem, *start, FREE, iterations=100, tolerance=1e-12)
    np.testing.assert_allclose(whiten(problem, found.world_from_sonar, found.xyz_m), 0, atol=1e-3)
    np.testing.assert_array_equal(found.world_from_sonar[0], start[0][0])
    assert adjust_dense(problem, *start, FREE, iterations=0).cost > 1e3 * found.cost


def test_kernel_keeps_a_wrong_observation_from_moving_the_rest() -> None:
    problem, poses, xyz_m = make_problem()
    spoiled = problem.range_bearing.copy()
    spoiled[14] += [0.4, 0.2]
    errors_m = []
    for scale in (np.inf, 1.0):
        wrong = replace(problem, range_bearing=spoiled, cauchy_sigmas=scale, elevation_sigma_rad=0.5)
        found = adjust_dense(wrong, poses, xyz_m, FREE, iterations=50, tolerance=1e-8)
        errors_m.append(float(np.abs(found.world_from_sonar - poses)[:, :3, 3].max()))
    assert errors_m[1] < 0.2 * errors_m[0]
