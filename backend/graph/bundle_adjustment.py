"""Bundle adjustment: factor graph of poses and points, optimised inside the elevation aperture (active set)."""

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
    first_pose_factor,
    range_factor,
    step_factor,
)
from asfm.backend.graph.problem import FIRST_POINT, FIRST_POSE, BundleProblem
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.types import BoolArray, FloatArray

ITERATIONS_PER_CHECK = 4
"""Iterations of Levenberg-Marquardt between two updates of the active set."""
MAX_CHECKS = 15
"""Updates of the active set at most."""
PROXIMAL_SIGMA = 1.0
"""Sigma of the proximal term on a point's elevation, as a multiple of half the aperture."""


@dataclass(frozen=True)
class Bundle:
    """Optimum of a factor graph."""

    world_from_vehicle: FloatArray
    """(N, 4, 4) poses."""
    xyz_m: FloatArray
    """(T, 3) points in the world frame; those of tracks without a factor keep their initial value."""
    in_graph: BoolArray
    """(T,) whether each track has factors."""
    graph: gtsam.NonlinearFactorGraph
    """Graph for covariances: the measurements, and one aperture prior per point. The factors of the active set are
    not part of it: a bound that many observations reach is one piece of information, not many."""
    measured: gtsam.NonlinearFactorGraph
    """Graph of the measurements alone."""
    values: gtsam.Values
    """The poses and points of the graph, as GTSAM takes them."""


def adjust_bundle(
    problem: BundleProblem, world_from_vehicle: FloatArray, xyz_m: FloatArray, relative_tolerance: float = 1e-3
) -> Bundle:
    """Optimise all poses and points jointly by Levenberg-Marquardt, with Cauchy kernels on the sonar's factors.

    Args:
        problem: measurements with their sigmas.
        world_from_vehicle: (N, 4, 4) initial poses.
        xyz_m: (T, 3) initial points, world frame.
        relative_tolerance: relative change of the cost between two updates of the active set below which the
            optimisation ends.
    """
    measured = gtsam.NonlinearFactorGraph()
    _add_sensor_factors(measured, problem.sensors, world_from_vehicle)
    _add_sonar_factors(measured, problem)
    in_graph = np.zeros(len(xyz_m), dtype=bool)
    in_graph[problem.tracks.track[problem.observed]] = True
    values = _optimise_in_aperture(measured, problem, world_from_vehicle, xyz_m, in_graph, relative_tolerance)
    poses, points = _read_values(values, len(world_from_vehicle), xyz_m, in_graph)
    graph = measured.clone()
    add_aperture_priors(graph, problem, poses, points)
    return Bundle(poses, points, in_graph, graph, measured, values)


def _optimise_in_aperture(
    measured: gtsam.NonlinearFactorGraph,
    problem: BundleProblem,
    poses: FloatArray,
    points: FloatArray,
    in_graph: BoolArray,
    relative_tolerance: float,
) -> gtsam.Values:
    """Optimise under the constraint that points lie in the elevation aperture, by an active set of bounds.

    Every few iterations the points outside the aperture are moved to its edge, and the observations that see them
    outside get a factor at the edge. A proximal term limits how far an elevation moves between two such updates to
    about half the aperture, and vanishes at the optimum: without it a weakly observed elevation would leave the
    aperture in one step and move the poses along.
    """
    cost = np.inf
    middle = middle_observations(problem)
    for check in range(MAX_CHECKS):
        cost_before = cost
        outside, edge_rad = aperture_violations(problem, poses, points)
        points = clamp_to_aperture(problem, poses, points)
        bounded = measured.clone()
        add_elevation_factors(bounded, problem, outside, edge_rad, EDGE_RAD)
        proximal = bounded.clone()
        elevation_rad = observed_elevations(problem, poses, points)
        add_elevation_factors(proximal, problem, middle, elevation_rad, PROXIMAL_SIGMA * problem.half_aperture_rad)
        values = _optimise(proximal, make_values(poses, points, in_graph))
        poses, points = _read_values(values, len(poses), points, in_graph)
        cost = bounded.error(values)
        if check > 0 and abs(cost_before - cost) <= relative_tolerance * cost:
            break
    return values


def _add_sensor_factors(
    graph: gtsam.NonlinearFactorGraph, sensors: SensorConstraints, world_from_vehicle: FloatArray
) -> None:
    """Add the prior on the first pose, the steps, depth and attitude.

    Args:
        graph: is changed in place.
        sensors: constraints on N frames.
        world_from_vehicle: (N, 4, 4) poses whose heading separates roll from pitch in the attitude factors.
    """
    graph.add(first_pose_factor(FIRST_POSE, sensors.first_pose, sensors.first_sigma))
    for index, (step, sigma) in enumerate(zip(sensors.steps, sensors.step_sigma.tolist(), strict=True)):
        graph.add(step_factor(FIRST_POSE + index, FIRST_POSE + index + 1, step, *sigma))
    heading_rad = np.arctan2(world_from_vehicle[:, 1, 0], world_from_vehicle[:, 0, 0])
    for index, (reading, sigma) in enumerate(zip(sensors.z_roll_pitch, sensors.z_roll_pitch_sigma, strict=True)):
        if np.isfinite(sigma[0]):
            graph.add(depth_factor(FIRST_POSE + index, float(reading[0]), float(sigma[0])))
        if np.isfinite(sigma[1:]).any():
            graph.add(attitude_factor(FIRST_POSE + index, reading[1:], sigma[1:], float(heading_rad[index])))


def _add_sonar_factors(graph: gtsam.NonlinearFactorGraph, problem: BundleProblem) -> None:
    """Add a bearing and a range factor for each used observation."""
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
    """Return the values of a graph.

    Args:
        world_from_vehicle: (N, 4, 4) poses.
        xyz_m: (T, 3) points in the world frame.
        in_graph: (T,) which points are part of the graph.
    """
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
    parameters.setMaxIterations(ITERATIONS_PER_CHECK)
    parameters.setRelativeErrorTol(1e-5)
    return gtsam.LevenbergMarquardtOptimizer(graph, initial, parameters).optimize()
