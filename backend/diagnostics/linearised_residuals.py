"""Linearised residuals of all sensors: whitened and weighted, with derivatives by pose, point and calibration."""

from dataclasses import dataclass

import numpy as np

from asfm.backend.diagnostics.calibration_parameters import NUMBER, PARAMETERS
from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.factors import CAUCHY_SIGMAS, HUBER_SIGMAS
from asfm.geometry.poses import (
    adjoint,
    cross_matrix,
    depth_roll_pitch,
    invert,
    pose_log,
    steps_between,
    transform,
    wrap_angle,
)
from asfm.geometry.sonar import project, project_jacobian
from asfm.types import FloatArray, IntArray


@dataclass(frozen=True)
class ResidualBlock:
    """M measurements of D values each by one kind of sensor, linearised at the optimum."""

    sensor: str
    """sonar, odometry, or depth and attitude."""
    frame: IntArray
    """(M,) frame of each measurement; of a step, the one where it begins."""
    residual: FloatArray
    """(M, D) predicted minus measured, in standard deviations; 0 where nothing was measured."""
    weight: FloatArray
    """(M, D) weights of the robust kernel; 0 where nothing was measured."""
    by_pose: tuple[tuple[IntArray, FloatArray], ...]
    """(M,) frame and (M, D, 6) derivative by its pose: rotation and translation in the vehicle's frame."""
    by_parameter: FloatArray
    """(M, D, K) derivative by the calibration parameters."""
    track: IntArray | None = None
    """(M,) the track whose point was measured."""
    by_point: FloatArray | None = None
    """(M, D, 3) derivative by that point, world frame."""


def linearise_sonar(solution: Solution) -> ResidualBlock:
    """Linearise range and bearing of all used observations: D = 2."""
    problem, tracks, used = solution.problem, solution.tracks, solution.observed
    frame, track, sigma = tracks.frame[used], tracks.track[used], problem.sigma[used]
    world_from_vehicle, vehicle_from_sonar = solution.bundle.world_from_vehicle[frame], problem.vehicle_from_sonar
    in_vehicle = transform(invert(world_from_vehicle), solution.bundle.xyz_m[track])
    in_sonar = transform(invert(vehicle_from_sonar), in_vehicle)
    range_m, bearing_rad, _ = project(in_sonar)
    error = [range_m - tracks.range_m[used], wrap_angle(bearing_rad - tracks.bearing_rad[used])]
    residual = np.stack(error, axis=1) / sigma
    by_sonar_point = project_jacobian(in_sonar)[:, :2] / sigma[:, :, None]
    by_vehicle_point = by_sonar_point @ vehicle_from_sonar[:3, :3].T
    by_pose = np.concatenate([by_vehicle_point @ cross_matrix(in_vehicle), -by_vehicle_point], axis=2)
    by_parameter = np.zeros((*residual.shape, len(PARAMETERS)))
    by_parameter[:, 0, NUMBER["range_scale"]] = range_m / sigma[:, 0]
    by_parameter[:, 0, NUMBER["range_bias"]] = 1 / sigma[:, 0]
    by_parameter[:, 1, NUMBER["bearing_scale"]] = bearing_rad / sigma[:, 1]
    by_rotation = by_sonar_point @ cross_matrix(in_sonar)
    for axis, name in enumerate(("mounting_roll", "mounting_pitch", "mounting_yaw")):
        by_parameter[:, :, NUMBER[name]] = by_rotation[:, :, axis]
    for axis, name in enumerate(("lever_x", "lever_y", "lever_z")):
        by_parameter[:, :, NUMBER[name]] = -by_vehicle_point[:, :, axis]
    return ResidualBlock(
        sensor="sonar",
        frame=frame,
        residual=residual,
        weight=1 / (1 + (residual / CAUCHY_SIGMAS) ** 2),
        by_pose=((frame, by_pose),),
        by_parameter=by_parameter,
        track=track,
        by_point=by_vehicle_point @ np.swapaxes(world_from_vehicle[:, :3, :3], 1, 2),
    )


def linearise_odometry(solution: Solution, timestamps_s: FloatArray) -> ResidualBlock:
    """Linearise the N - 1 steps of the odometry: D = 6, rotation and translation in the frame of the later pose."""
    sensors, poses = solution.problem.sensors, solution.bundle.world_from_vehicle
    sigma = np.repeat(sensors.step_sigma, 3, axis=1)
    steps = steps_between(poses)
    by_parameter = np.zeros((len(steps), 6, len(PARAMETERS)))
    # The estimated step, not the measured one: its noise would be part of both sides of the regression.
    along_m = np.einsum("nji,nj->ni", sensors.steps[:, :3, :3], steps[:, :3, 3])
    by_parameter[:, 3:, NUMBER["odometry_scale"]] = along_m
    change = _change_of_steps(steps, timestamps_s)
    by_parameter[:, :, NUMBER["odometry_delay"]] = by_parameter[:, :, NUMBER["image_advance"]] = -change
    first, second = np.arange(len(steps)), np.arange(1, len(steps) + 1)
    identity = np.repeat(np.eye(6)[None], len(steps), axis=0)
    residual = pose_log(invert(sensors.steps) @ steps) / sigma
    return ResidualBlock(
        sensor="odometry",
        frame=first,
        residual=residual,
        weight=np.ones_like(residual),
        by_pose=((first, -adjoint(invert(steps)) / sigma[:, :, None]), (second, identity / sigma[:, :, None])),
        by_parameter=by_parameter / sigma[:, :, None],
    )


def _change_of_steps(steps: FloatArray, timestamps_s: FloatArray) -> FloatArray:
    """Return the (N - 1, 6) rate at which the steps change with time, rad/s and m/s."""
    if len(steps) < 2:
        return np.zeros((len(steps), 6))
    interval_s = np.diff(timestamps_s)
    twist = pose_log(steps) / interval_s[:, None]
    middle_s = (timestamps_s[1:] + timestamps_s[:-1]) / 2
    return np.asarray(np.gradient(twist, middle_s, axis=0) * interval_s[:, None])


def linearise_depth_attitude(solution: Solution, timestamps_s: FloatArray) -> ResidualBlock:
    """Linearise height, roll and pitch at the N frames: D = 3."""
    sensors, poses = solution.problem.sensors, solution.bundle.world_from_vehicle
    predicted = depth_roll_pitch(poses)
    difference = predicted - sensors.z_roll_pitch
    difference[:, 1:] = wrap_angle(difference[:, 1:])
    residual = difference / sensors.z_roll_pitch_sigma
    _, roll_rad, pitch_rad = predicted.T
    by_pose = np.zeros((len(poses), 3, 6))
    by_pose[:, 0, 3:] = poses[:, 2, :3]
    by_pose[:, 1, 0] = 1.0
    by_pose[:, 1, 1], by_pose[:, 1, 2] = (turn(roll_rad) * np.tan(pitch_rad) for turn in (np.sin, np.cos))
    by_pose[:, 2, 1], by_pose[:, 2, 2] = np.cos(roll_rad), -np.sin(roll_rad)
    by_parameter = np.zeros((len(poses), 3, len(PARAMETERS)))
    rate = np.gradient(predicted, timestamps_s, axis=0) if len(poses) > 1 else np.zeros_like(predicted)
    by_parameter[:, :, NUMBER["navigation_delay"]] = by_parameter[:, :, NUMBER["image_advance"]] = -rate
    by_parameter[:, 0, NUMBER["depth_scale"]] = predicted[:, 0] - predicted[:, 0].mean()
    sigma = sensors.z_roll_pitch_sigma[:, :, None]
    return ResidualBlock(
        sensor="depth and attitude",
        frame=np.arange(len(poses)),
        residual=residual,
        weight=np.where(np.isfinite(sensors.z_roll_pitch_sigma), _huber_weight(residual), 0.0),
        by_pose=((np.arange(len(poses)), by_pose / sigma),),
        by_parameter=by_parameter / sigma,
    )


def _huber_weight(residual: FloatArray) -> FloatArray:
    return HUBER_SIGMAS / np.maximum(np.abs(residual), HUBER_SIGMAS)


def linearise_residuals(solution: Solution, timestamps_s: FloatArray) -> tuple[ResidualBlock, ...]:
    """Linearise the residuals of all sensors that measured anything.

    Args:
        solution: poses and points at the optimum.
        timestamps_s: (N,) stamps of the frames.
    """
    sensors = solution.problem.sensors
    blocks = [linearise_sonar(solution)] if solution.observed.any() else []
    if sensors.measured and len(sensors.steps):
        blocks.append(linearise_odometry(solution, timestamps_s))
    if len(sensors.z_roll_pitch):
        blocks.append(linearise_depth_attitude(solution, timestamps_s))
    return tuple(blocks)
