"""The factor graph of a reconstruction: built from tracks and sensors, optimised, and asked for its covariances."""

from dataclasses import dataclass

import gtsam
import numpy as np

from asfm.backend.factors import (
    aperture_factor,
    attitude_factor,
    bearing_factor,
    depth_factor,
    range_factor,
    step_factor,
)
from asfm.backend.sensors import SensorConstraints
from asfm.poses import invert, transform
from asfm.sonar import project
from asfm.types import BoolArray, FloatArray, Tracks

FIRST_POSE = gtsam.symbol("x", 0)
FIRST_POINT = gtsam.symbol("l", 0)
APERTURE_ROUNDS = 15


@dataclass(frozen=True)
class Bundle:
    """The optimum of a graph."""

    world_from_vehicle: FloatArray
    """(N, 4, 4)"""
    xyz_m: FloatArray
    """(T, 3) points in the world; those of tracks without a factor keep their initial value."""
    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    track_in_graph: BoolArray
    """(T,)"""


def adjust_bundle(
    tracks: Tracks,
    observed: BoolArray,
    sigma: FloatArray,
    xyz_m: FloatArray,
    world_from_vehicle: FloatArray,
    sensors: SensorConstraints,
    vehicle_from_sonar: FloatArray,
    half_aperture_rad: float,
    max_iterations: int = 4,
) -> Bundle:
    """Optimise all poses and points at once, by Levenberg-Marquardt with Cauchy kernels on the sonar's factors.

    Args:
        tracks: (O,) observations.
        observed: (O,) which of them enter the graph.
        sigma: (O, 2) standard deviations of range_m and bearing_rad.
        xyz_m: (T, 3) initial points, world frame.
        world_from_vehicle: (N, 4, 4) initial poses.
        sensors: odometry, depth and attitude, or what stands in for them.
        vehicle_from_sonar: (4, 4) lever arm.
    """
    graph = gtsam.NonlinearFactorGraph()
    _add_sensor_factors(graph, sensors, world_from_vehicle)
    _add_sonar_factors(graph, tracks, observed, sigma, gtsam.Pose3(vehicle_from_sonar))
    used = np.zeros(len(xyz_m), dtype=bool)
    used[tracks.track[observed]] = True
    poses, points = world_from_vehicle, xyz_m
    outside, last_error = np.zeros(len(tracks), dtype=bool), np.inf
    for _ in range(APERTURE_ROUNDS):
        held = graph.clone()
        before = outside
        outside = _add_aperture_factors(held, tracks, observed, points, poses, vehicle_from_sonar, half_aperture_rad)
        values = _optimise(held, _initial_values(poses, points, used), max_iterations)
        poses = np.stack([values.atPose3(FIRST_POSE + index).matrix() for index in range(len(poses))])
        points = points.copy()
        for index in np.flatnonzero(used).tolist():
            points[index] = values.atPoint3(FIRST_POINT + index)
        error = held.error(values)
        if (outside == before).all() and abs(last_error - error) < 1e-4 * error:
            break
        last_error = error
    return Bundle(poses, points, held, values, used)


def _initial_values(world_from_vehicle: FloatArray, xyz_m: FloatArray, used: BoolArray) -> gtsam.Values:
    initial = gtsam.Values()
    for index, pose in enumerate(world_from_vehicle):
        initial.insert(FIRST_POSE + index, gtsam.Pose3(pose))
    for index in np.flatnonzero(used).tolist():
        initial.insert(FIRST_POINT + index, xyz_m[index])
    return initial


def _optimise(graph: gtsam.NonlinearFactorGraph, initial: gtsam.Values, max_iterations: int) -> gtsam.Values:
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(max_iterations)
    parameters.setRelativeErrorTol(1e-5)
    return gtsam.LevenbergMarquardtOptimizer(graph, initial, parameters).optimize()


def _add_aperture_factors(graph, tracks, observed, xyz_m, world_from_vehicle, vehicle_from_sonar, half_aperture_rad):
    sonar_from_world = invert(world_from_vehicle @ vehicle_from_sonar)[tracks.frame]
    _, _, elevation_rad = project(transform(sonar_from_world, xyz_m[tracks.track]))
    outside = observed & (np.abs(elevation_rad) > half_aperture_rad)
    lever = gtsam.Pose3(vehicle_from_sonar)
    for index in np.flatnonzero(outside).tolist():
        edge = float(np.copysign(half_aperture_rad, elevation_rad[index]))
        graph.add(
            aperture_factor(
                FIRST_POSE + int(tracks.frame[index]),
                FIRST_POINT + int(tracks.track[index]),
                float(tracks.bearing_rad[index]),
                edge,
                lever,
            )
        )
    return outside


def landmark_covariances(bundle: Bundle) -> FloatArray:
    """Marginal covariance of every point, (T, 3, 3) in m^2; NaN where the track has no factor."""
    marginals = gtsam.Marginals(bundle.graph, bundle.values)
    covariance = np.full((len(bundle.xyz_m), 3, 3), np.nan)
    for index in np.flatnonzero(bundle.track_in_graph).tolist():
        covariance[index] = marginals.marginalCovariance(FIRST_POINT + index)
    return covariance


def _add_sonar_factors(
    graph: gtsam.NonlinearFactorGraph,
    tracks: Tracks,
    observed: BoolArray,
    sigma: FloatArray,
    vehicle_from_sonar: gtsam.Pose3,
) -> None:
    pose_keys = (FIRST_POSE + tracks.frame[observed]).tolist()
    point_keys = (FIRST_POINT + tracks.track[observed]).tolist()
    measured = np.stack([tracks.range_m, tracks.bearing_rad], axis=1)[observed].tolist()
    for pose, point, (range_m, bearing_rad), (range_sigma, bearing_sigma) in zip(
        pose_keys, point_keys, measured, sigma[observed].tolist(), strict=True
    ):
        graph.add(bearing_factor(pose, point, bearing_rad, bearing_sigma, vehicle_from_sonar))
        graph.add(range_factor(pose, point, range_m, range_sigma, vehicle_from_sonar))


def _add_sensor_factors(
    graph: gtsam.NonlinearFactorGraph, sensors: SensorConstraints, world_from_vehicle: FloatArray
) -> None:
    graph.add(
        gtsam.PriorFactorPose3(
            FIRST_POSE, gtsam.Pose3(sensors.first_pose), gtsam.noiseModel.Gaussian.Covariance(sensors.first_covariance)
        )
    )
    for index, step in enumerate(sensors.steps):
        graph.add(step_factor(FIRST_POSE + index, FIRST_POSE + index + 1, step, *sensors.step_sigma[index].tolist()))
    for index, reading in enumerate(sensors.z_roll_pitch):
        z_m, roll_rad, pitch_rad = reading.tolist()
        z_sigma, angle_sigma = sensors.z_angle_sigma
        graph.add(depth_factor(FIRST_POSE + index, z_m, z_sigma))
        graph.add(attitude_factor(FIRST_POSE + index, roll_rad, pitch_rad, angle_sigma))
