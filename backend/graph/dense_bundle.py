"""Dense bundle adjustment: Levenberg-Marquardt over sonar poses and points in arrays, points eliminated.

It is meant for starts: small problems, solved many times, from poses and elevations that may be far from the truth. The
elevation of a point is hardly measured at first, and a Gauss-Newton step along it can be of any length; a trust region
on the elevations, and not on the poses, therefore bounds each step.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError

from asfm.backend.graph.dense_problem import DenseProblem, all_sigmas, observed_points, whiten_observed
from asfm.backend.graph.normal_equations import NormalEquations, move_poses, summation_matrix
from asfm.geometry.poses import adjoint, cross_matrix, invert, pose_log, steps_between
from asfm.geometry.sonar import project_jacobian
from asfm.types import BoolArray, FloatArray

TRUST_RADIUS = 1.0
"""First radius of the trust region on elevations, in half apertures."""
TRUST_RADII_RAD = 1e-4, 300.0
"""Radius at which no step is found any more, and the largest one."""
GROWTH, SHRINKAGE = 2.0, 3.0
"""Factors of the radius after a step that lowers the cost, and after one that does not."""
DAMPING = 1e-9
"""Share of the diagonal added to it at the first radius; it grows with the fourth power of a smaller one."""
SMALL_GAINS = 2
"""The adjustment ends after so many steps in a row that gain less than the tolerance."""


@dataclass(frozen=True)
class DenseBundle:
    """Optimum of a dense problem."""

    world_from_sonar: FloatArray
    """(N, 4, 4)"""
    xyz_m: FloatArray
    """(T, 3) points, world frame."""
    cost: float
    """Half the sum of squares, robust for observations."""


@dataclass(frozen=True)
class _Linearisation:
    in_sonar: FloatArray
    """(O, 3)"""
    residual: FloatArray
    """(O, 3) range, bearing and elevation in sigmas."""
    by_point: FloatArray
    """(O, 3, 3) derivative by the point in the sonar frame."""
    elevation_by_point: FloatArray
    """(O, 3) derivative of the elevation in rad by the point in the sonar frame."""
    weight: FloatArray
    """(O, 3)"""


def adjust_dense(
    problem: DenseProblem,
    world_from_sonar: FloatArray,
    xyz_m: FloatArray,
    free: BoolArray,
    iterations: int = 20,
    tolerance: float = 1e-2,
) -> DenseBundle:
    """Optimise poses and points.

    Args:
        problem: O observations of T points from N poses.
        world_from_sonar: (N, 4, 4) initial poses.
        xyz_m: (T, 3) initial points, world frame.
        free: (N,) poses that may move.
        iterations: steps at most.
        tolerance: relative gain of a step that counts as small.
    """
    start_m, radius_rad, small = xyz_m, _first_radius_rad(problem), 0
    best = DenseBundle(world_from_sonar, xyz_m, _cost(problem, world_from_sonar, xyz_m, start_m))
    for _ in range(iterations):
        system, found = _normal_equations(problem, best, start_m, free), None
        while found is None and radius_rad > TRUST_RADII_RAD[0]:
            found = _try_step(problem, best, system, start_m, free, radius_rad)
            radius_rad = radius_rad / SHRINKAGE if found is None else min(radius_rad * GROWTH, TRUST_RADII_RAD[1])
        if found is None:
            break
        small = small + 1 if best.cost - found.cost < tolerance * best.cost else 0
        best = found
        if small == SMALL_GAINS:
            break
    return best


def _first_radius_rad(problem: DenseProblem) -> float:
    return TRUST_RADIUS * problem.half_aperture_rad


def _cost(problem: DenseProblem, world_from_sonar: FloatArray, xyz_m: FloatArray, start_m: FloatArray) -> float:
    squares = whiten_observed(problem, observed_points(problem, world_from_sonar, xyz_m)) ** 2
    measured, scale = squares[:, :2].sum(axis=1), problem.cauchy_sigmas
    total = measured.sum() if np.isinf(scale) else scale**2 * np.log1p(measured / scale**2).sum()
    total += squares[:, 2].sum()
    total += (((xyz_m - start_m) / problem.point_sigma_m) ** 2).sum()
    total += ((pose_log(steps_between(world_from_sonar)) / np.repeat(problem.step_sigma, 3, axis=1)) ** 2).sum()
    return float(total / 2)


def _linearise(problem: DenseProblem, bundle: DenseBundle) -> _Linearisation:
    in_sonar = observed_points(problem, bundle.world_from_sonar, bundle.xyz_m)
    residual, jacobian = whiten_observed(problem, in_sonar), project_jacobian(in_sonar)
    weight = np.ones_like(residual)
    if np.isfinite(problem.cauchy_sigmas):
        weight[:, :2] = 1 / (1 + (residual[:, :2] ** 2).sum(axis=1, keepdims=True) / problem.cauchy_sigmas**2)
    return _Linearisation(in_sonar, residual, jacobian / all_sigmas(problem)[:, :, None], jacobian[:, 2], weight)


def _normal_equations(
    problem: DenseProblem, bundle: DenseBundle, start_m: FloatArray, free: BoolArray
) -> tuple[NormalEquations, FloatArray]:
    """Return the normal equations of the free poses and all points, and the (T, 3, 3) squares of unit elevations."""
    poses, count, points = bundle.world_from_sonar, int(free.sum()), len(bundle.xyz_m)
    linear = _linearise(problem, bundle)
    column = np.cumsum(free) - 1
    sonar_from_world = np.swapaxes(poses[problem.frame, :3, :3], 1, 2)
    by_point = linear.by_point @ sonar_from_world
    weighted = np.swapaxes(by_point * linear.weight[:, :, None], 1, 2)
    of_track = summation_matrix(problem.track, points)
    own = (of_track @ (weighted @ by_point).reshape(-1, 9)).reshape(-1, 3, 3) + np.eye(3) / problem.point_sigma_m**2
    by_points = of_track @ (weighted @ linear.residual[:, :, None])[:, :, 0]
    by_points += (bundle.xyz_m - start_m) / problem.point_sigma_m**2
    moved = np.flatnonzero(free[problem.frame])
    frame, track = column[problem.frame[moved]], problem.track[moved]
    in_sonar, derivative = linear.in_sonar[moved], linear.by_point[moved]
    by_pose = np.concatenate([derivative @ cross_matrix(in_sonar), -derivative], axis=2)
    pose_weighted = np.swapaxes(by_pose * linear.weight[moved][:, :, None], 1, 2)
    of_frame = summation_matrix(frame, count)
    mixed = np.zeros((count, points, 6, 3))
    mixed[frame, track] = pose_weighted @ by_point[moved]
    information, by_poses = _motion_prior(problem, poses, free)
    diagonal = np.arange(count)
    blocks = information.reshape(count, 6, count, 6)
    blocks[diagonal, :, diagonal] += (of_frame @ (pose_weighted @ by_pose).reshape(-1, 36)).reshape(-1, 6, 6)
    by_poses += (of_frame @ (pose_weighted @ linear.residual[moved][:, :, None])[:, :, 0]).ravel()
    system = NormalEquations(
        gradient=np.concatenate([by_poses, by_points.ravel()]),
        poses=information,
        mixed=mixed.swapaxes(1, 2).reshape(6 * count, 3 * points),
        points=own,
    )
    views = np.bincount(problem.track, minlength=points)[problem.track]
    elevation = (linear.elevation_by_point[:, None] @ sonar_from_world)[:, 0] / np.sqrt(views)[:, None]
    squares = (of_track @ (elevation[:, :, None] * elevation[:, None, :]).reshape(-1, 9)).reshape(-1, 3, 3)
    return system, squares


def _motion_prior(problem: DenseProblem, poses: FloatArray, free: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return the (6 F, 6 F) information and the (6 F,) gradient of the motion prior for the F free poses."""
    steps, count = steps_between(poses), len(poses)
    scale = 1 / np.repeat(problem.step_sigma, 3, axis=1)
    residual, first = pose_log(steps) * scale, -adjoint(invert(steps)) * scale[:, :, None]
    second = np.eye(6) * scale[:, :, None]
    information, gradient = np.zeros((count, 6, count, 6)), np.zeros((count, 6))
    one, other = np.arange(count - 1), np.arange(1, count)
    for a, by_a in ((one, first), (other, second)):
        gradient[a] += np.einsum("nij,ni->nj", by_a, residual)
        for b, by_b in ((one, first), (other, second)):
            information[a, :, b] += np.swapaxes(by_a, 1, 2) @ by_b
    which = np.flatnonzero(free)
    return information[which][:, :, which].reshape(6 * len(which), -1), gradient[which].ravel()


def _try_step(
    problem: DenseProblem,
    bundle: DenseBundle,
    system: tuple[NormalEquations, FloatArray],
    start_m: FloatArray,
    free: BoolArray,
    radius_rad: float,
) -> DenseBundle | None:
    """Return the bundle after a step; None where its cost is not lower, or the equations are singular."""
    equations, squares = system
    try:
        damping = DAMPING * max(1.0, _first_radius_rad(problem) / radius_rad) ** 4
        motion, shift_m = equations.solve(damping, squares / radius_rad**2)
    except LinAlgError:
        return None
    poses, xyz_m = bundle.world_from_sonar.copy(), bundle.xyz_m + shift_m
    poses[free] = move_poses(poses[free], motion)
    cost = _cost(problem, poses, xyz_m, start_m)
    return DenseBundle(poses, xyz_m, cost) if cost <= bundle.cost else None
