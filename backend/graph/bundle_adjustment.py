"""The factor graph of a reconstruction: built from tracks and sensors, optimised, and asked for its covariances."""

from dataclasses import dataclass

import gtsam
import numpy as np

from asfm.backend.graph.aperture_bounds import (
    EDGE_RAD,
    add_aperture_priors,
    add_elevation_factors,
    aperture_violations,
    clamp_to_aperture,
    middle_observations,
    observed_elevations,
)
from asfm.backend.graph.factors import (
    attitude_factor,
    bearing_factor,
    depth_factor,
    range_factor,
    step_factor,
)
from asfm.backend.graph.problem import FIRST_POINT, FIRST_POSE, BundleProblem
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.types import BoolArray, FloatArray

ITERATIONS_BETWEEN_CHECKS = 4
"""Steps of Levenberg-Marquardt before it is looked again which points have left the beam."""
MAX_CHECKS = 15
PROXIMITY = 1.0
"""How far a point's elevation moves between two checks, over half the aperture: elevations that nothing tells would
leave the beam in one step."""


@dataclass(frozen=True)
class Bundle:
    """The optimum of a graph."""

    world_from_vehicle: FloatArray
    """(N, 4, 4)"""
    xyz_m: FloatArray
    """(T, 3) points in the world; those of tracks without a factor keep their initial value."""
    in_graph: BoolArray
    """(T,) which tracks have factors."""
    graph: gtsam.NonlinearFactorGraph
    """What the covariances follow from: the measurements, and once a point that it lies in the beam. The pulls that
    held points inside during the optimisation are left out: a bound met many times is not many measurements."""
    measured: gtsam.NonlinearFactorGraph
    """The measurements alone."""
    values: gtsam.Values


def adjust_bundle(
    problem: BundleProblem, world_from_vehicle: FloatArray, xyz_m: FloatArray, settled: float = 1e-3
) -> Bundle:
    """Optimise all poses and points at once, by Levenberg-Marquardt with Cauchy kernels on the sonar's factors.

    Points must stay inside the beam. That is an inequality, so it is kept as an active set: every few iterations,
    points that have left the elevation aperture are moved to its edge, and the observations that saw them outside get a
    factor that pulls them there. Between two such checks a point's elevation may move by about half the aperture
    (a proximal term, which vanishes at the optimum): else the elevations that little tells would be thrown out of the
    beam in one step and bring their poses along.

    Args:
        problem: what is known.
        world_from_vehicle: (N, 4, 4) initial poses.
        xyz_m: (T, 3) initial points, world frame.
        settled: relative change of the cost between two checks below which the optimum counts as reached.
    """
    graph = gtsam.NonlinearFactorGraph()
    _add_sensor_factors(graph, problem.sensors, world_from_vehicle)
    _add_sonar_factors(graph, problem)
    in_graph = np.zeros(len(xyz_m), dtype=bool)
    in_graph[problem.tracks.track[problem.observed]] = True
    poses, points = world_from_vehicle, xyz_m
    cost = np.inf
    middle = middle_observations(problem)
    for check in range(MAX_CHECKS):
        cost_before = cost
        outside, edge_rad = aperture_violations(problem, poses, points)
        points = clamp_to_aperture(problem, poses, points)
        held = graph.clone()
        add_elevation_factors(held, problem, outside, edge_rad, EDGE_RAD)
        kept = held.clone()
        elevation_rad = observed_elevations(problem, poses, points)
        add_elevation_factors(kept, problem, middle, elevation_rad, PROXIMITY * problem.half_aperture_rad)
        values = _optimise(kept, make_values(poses, points, in_graph))
        poses, points = _read_values(values, len(poses), points, in_graph)
        cost = held.error(values)
        if check > 0 and abs(cost_before - cost) <= settled * cost:
            break
    measured = graph.clone()
    add_aperture_priors(graph, problem, poses, points)
    return Bundle(poses, points, in_graph, graph, measured, values)


def _add_sensor_factors(
    graph: gtsam.NonlinearFactorGraph, sensors: SensorConstraints, world_from_vehicle: FloatArray
) -> None:
    """Add what the sensors say; the poses, (N, 4, 4), give the heading that tells roll from pitch."""
    noise = gtsam.noiseModel.Gaussian.Covariance(sensors.first_covariance)
    graph.add(gtsam.PriorFactorPose3(FIRST_POSE, gtsam.Pose3(sensors.first_pose), noise))
    for index, (step, sigma) in enumerate(zip(sensors.steps, sensors.step_sigma.tolist(), strict=True)):
        graph.add(step_factor(FIRST_POSE + index, FIRST_POSE + index + 1, step, *sigma))
    heading_rad = np.arctan2(world_from_vehicle[:, 1, 0], world_from_vehicle[:, 0, 0])
    for index, (reading, sigma) in enumerate(zip(sensors.z_roll_pitch, sensors.z_roll_pitch_sigma, strict=True)):
        if np.isfinite(sigma[0]):
            graph.add(depth_factor(FIRST_POSE + index, float(reading[0]), float(sigma[0])))
        if np.isfinite(sigma[1:]).any():
            graph.add(attitude_factor(FIRST_POSE + index, reading[1:], sigma[1:], float(heading_rad[index])))


def _add_sonar_factors(graph: gtsam.NonlinearFactorGraph, problem: BundleProblem) -> None:
    tracks, observed = problem.tracks, problem.observed
    lever_arm = gtsam.Pose3(problem.vehicle_from_sonar)
    for pose, point, range_m, bearing_rad, (range_sigma, bearing_sigma) in zip(
        (FIRST_POSE + tracks.frame[observed]).tolist(),
        (FIRST_POINT + tracks.track[observed]).tolist(),
        tracks.range_m[observed].tolist(),
        tracks.bearing_rad[observed].tolist(),
        problem.sigma[observed].tolist(),
        strict=True,
    ):
        graph.add(bearing_factor(pose, point, bearing_rad, bearing_sigma, lever_arm))
        graph.add(range_factor(pose, point, range_m, range_sigma, lever_arm))


def make_values(world_from_vehicle: FloatArray, xyz_m: FloatArray, in_graph: BoolArray) -> gtsam.Values:
    """Give the values of a graph: (N, 4, 4) poses, and of the (T, 3) points those that are in it."""
    values = gtsam.Values()
    for index, pose in enumerate(world_from_vehicle):
        values.insert(FIRST_POSE + index, gtsam.Pose3(pose))
    for index in np.flatnonzero(in_graph).tolist():
        values.insert(FIRST_POINT + index, xyz_m[index])
    return values


def _read_values(
    values: gtsam.Values, pose_count: int, xyz_m: FloatArray, in_graph: BoolArray
) -> tuple[FloatArray, FloatArray]:
    poses = np.stack([values.atPose3(FIRST_POSE + index).matrix() for index in range(pose_count)])
    points = xyz_m.copy()
    for index in np.flatnonzero(in_graph).tolist():
        points[index] = values.atPoint3(FIRST_POINT + index)
    return poses, points


def _optimise(graph: gtsam.NonlinearFactorGraph, initial: gtsam.Values) -> gtsam.Values:
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(ITERATIONS_BETWEEN_CHECKS)
    parameters.setRelativeErrorTol(1e-5)
    return gtsam.LevenbergMarquardtOptimizer(graph, initial, parameters).optimize()
