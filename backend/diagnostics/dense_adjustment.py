"""Dense Levenberg-Marquardt adjustment of few frames: quick costs of a solution under other sensor readings.

The same residuals and robust kernels as in the bundle adjustment, without its graph: a short stretch of frames is
solved again in milliseconds an iteration, so that many hypotheses can be compared.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError

from asfm.backend.diagnostics.linearised_residuals import (
    ResidualBlock,
    linearise_depth_attitude,
    linearise_odometry,
    linearise_sonar,
)
from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.factors import CAUCHY_SIGMAS, HUBER_SIGMAS
from asfm.backend.graph.normal_equations import NormalEquations, move_poses, summation_matrix
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import project, project_jacobian
from asfm.types import FloatArray

MAX_STEPS = 20
RELATIVE_TOLERANCE = 2e-3
"""The adjustment ends when the cost falls by a smaller share than this twice."""
APERTURE_SIGMA_RAD = 0.002
"""Softness of the edge of the elevation aperture."""
FIRST_STEPS = 3
"""Steps before the cost is extrapolated."""
FORESEEN_STEPS = 4
"""Steps as good as the last one that a cost is given to fall."""
DAMPING = (1e-3, 1e6)
"""Damping at the beginning, and the one at which the adjustment gives up."""


@dataclass(frozen=True)
class DenseFit:
    """Optimum of a stretch of frames."""

    cost: float
    """Sum of the robust losses of all measurements, half a square of the residuals each where they are small."""
    world_from_vehicle: FloatArray
    """(N, 4, 4) poses."""
    xyz_m: FloatArray
    """(T, 3) points, world frame."""


def adjust_densely(solution: Solution, timestamps_s: FloatArray, hopeless_cost: float = np.inf) -> DenseFit:
    """Optimise all poses and points of a solution from where they are, in dense matrices.

    The cost does not depend on position and heading of the whole; the damping holds them.

    Args:
        solution: its problem, poses and points; every observed track has a point.
        timestamps_s: (N,) stamps of the frames.
        hopeless_cost: the adjustment is given up where the cost falls too slowly to come below this.

    Returns:
        The optimum near the given poses and points.
    """
    damping, small = DAMPING[0], 0
    blocks = _linearise_all(solution, timestamps_s)
    cost = sum(_robust_cost(block) for block in blocks)
    for number in range(MAX_STEPS):
        system, damping, before = _normal_equations(blocks, len(timestamps_s), solution.tracks.count), damping / 5, cost
        while damping < DAMPING[1]:
            try:
                moved = _step(solution, system, damping)
            except LinAlgError:
                damping *= 10
                continue
            blocks = _linearise_all(moved, timestamps_s)
            after = sum(_robust_cost(block) for block in blocks)
            if after <= cost:
                break
            damping *= 10
        else:
            break
        solution, cost = moved, after
        gain = before - cost
        small = small + 1 if gain < RELATIVE_TOLERANCE * cost else 0
        if small == 2 or (number >= FIRST_STEPS and cost - FORESEEN_STEPS * gain > hopeless_cost):
            break
    return DenseFit(cost, solution.bundle.world_from_vehicle, solution.bundle.xyz_m)


def _linearise_all(solution: Solution, timestamps_s: FloatArray) -> tuple[ResidualBlock, ...]:
    sonar = linearise_sonar(solution)
    steps, readings = linearise_odometry(solution, timestamps_s), linearise_depth_attitude(solution, timestamps_s)
    return sonar, _linearise_aperture(solution, sonar), steps, readings


def _normal_equations(blocks: tuple[ResidualBlock, ...], frames: int, tracks: int) -> NormalEquations:
    sonar, aperture, *others = blocks
    assert sonar.track is not None and sonar.by_point is not None and aperture.by_point is not None
    by_pose = np.concatenate([sonar.by_pose[0][1], aperture.by_pose[0][1]], axis=1)
    by_point = np.concatenate([sonar.by_point, aperture.by_point], axis=1)
    weight = np.concatenate([sonar.weight, aperture.weight], axis=1)[:, None]
    residual = np.concatenate([sonar.residual, aperture.residual], axis=1)[:, :, None]
    of_frame, of_track = summation_matrix(sonar.frame, frames), summation_matrix(sonar.track, tracks)
    pose_weighted, point_weighted = np.swapaxes(by_pose, 1, 2) * weight, np.swapaxes(by_point, 1, 2) * weight
    poses, mixed = np.zeros((frames, frames, 6, 6)), np.zeros((frames, tracks, 6, 3))
    diagonal = np.arange(frames)
    poses[diagonal, diagonal] = (of_frame @ (pose_weighted @ by_pose).reshape(-1, 36)).reshape(-1, 6, 6)
    mixed[sonar.frame, sonar.track] = pose_weighted @ by_point
    gradient = of_frame @ (pose_weighted @ residual)[:, :, 0]
    for block in others:
        for frame, derivative in block.by_pose:
            weighted = np.swapaxes(derivative, 1, 2) * block.weight[:, None]
            gradient[frame] += (weighted @ block.residual[:, :, None])[:, :, 0]
            for other, second in block.by_pose:
                poses[frame, other] += weighted @ second
    return NormalEquations(
        gradient=np.concatenate([gradient.ravel(), (of_track @ (point_weighted @ residual)[:, :, 0]).ravel()]),
        poses=poses.swapaxes(1, 2).reshape(6 * frames, 6 * frames),
        mixed=mixed.swapaxes(1, 2).reshape(6 * frames, 3 * tracks),
        points=(of_track @ (point_weighted @ by_point).reshape(-1, 9)).reshape(-1, 3, 3),
    )


def _linearise_aperture(solution: Solution, sonar: ResidualBlock) -> ResidualBlock:
    """Linearise the excess of elevations over the aperture: D = 1, like one more measurement of each observation."""
    problem, bundle = solution.problem, solution.bundle
    frame, track = sonar.frame, sonar.track
    assert track is not None
    world_from_vehicle, lever = bundle.world_from_vehicle[frame], problem.vehicle_from_sonar
    in_vehicle = transform(invert(world_from_vehicle), bundle.xyz_m[track])
    in_sonar = transform(invert(lever), in_vehicle)
    elevation_rad = project(in_sonar)[2]
    excess_rad = elevation_rad - np.clip(elevation_rad, -problem.half_aperture_rad, problem.half_aperture_rad)
    by_vehicle = project_jacobian(in_sonar)[:, 2] @ lever[:3, :3].T / APERTURE_SIGMA_RAD
    turn = np.cross(in_vehicle, by_vehicle)
    return ResidualBlock(
        sensor="aperture",
        frame=frame,
        residual=excess_rad[:, None] / APERTURE_SIGMA_RAD,
        weight=(excess_rad != 0).astype(float)[:, None],
        by_pose=((frame, -np.concatenate([turn, by_vehicle], axis=1)[:, None]),),
        by_parameter=np.zeros((len(frame), 1, 0)),
        track=track,
        by_point=np.einsum("mi,mji->mj", by_vehicle, world_from_vehicle[:, :3, :3])[:, None],
    )


def _robust_cost(block: ResidualBlock) -> float:
    """Sum the losses whose weights the block has: Cauchy for the sonar, Huber for depth and attitude, squares."""
    size = np.abs(np.where(block.weight > 0, block.residual, 0.0))
    if block.sensor == "sonar":
        return float(CAUCHY_SIGMAS**2 / 2 * np.log1p((size / CAUCHY_SIGMAS) ** 2).sum())
    if block.sensor == "depth and attitude":
        return float(np.where(size > HUBER_SIGMAS, HUBER_SIGMAS * (size - HUBER_SIGMAS / 2), size**2 / 2).sum())
    return float((size**2).sum() / 2)


def _step(solution: Solution, system: NormalEquations, damping: float) -> Solution:
    """Solve the damped normal equations, points eliminated, and move poses and points.

    Raises:
        LinAlgError: the damped equations are singular.
    """
    motion, shift_m = system.solve(damping)
    poses = move_poses(solution.bundle.world_from_vehicle, motion)
    points = solution.bundle.xyz_m + shift_m
    return replace(solution, bundle=replace(solution.bundle, world_from_vehicle=poses, xyz_m=points))
