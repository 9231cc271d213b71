"""Loop closure: poses optimised with the observations of landmarks across loops.

Drift separates the two observations of a landmark across a loop, so that they would not pass as one track. The graph of
the last round therefore gets the loops' matches as additional observations, of the landmark by the frame that sees it
again, and is optimised from its optimum: first with sigmas inflated to the residuals of the loops, then with their own.
"""

import gtsam
import numpy as np

from asfm.backend.graph.bundle_adjustment import Bundle
from asfm.backend.graph.factors import bearing_factor, range_factor
from asfm.backend.graph.problem import FIRST_POINT, FIRST_POSE
from asfm.geometry.poses import angle_difference, invert, transform
from asfm.geometry.sonar import project
from asfm.types import FloatArray, Tracks

MAX_ITERATIONS = 8
"""Iterations of each optimisation; the next round of adjustment continues from there."""
PASSES = 2
"""Optimisations, each with sigmas inflated to the median residual of the loops at its start."""


def close_loops(
    bundle: Bundle, loop_observations: Tracks, sigma: FloatArray, vehicle_from_sonar: FloatArray, correlation: float
) -> FloatArray:
    """Optimise the poses with additional observations of landmarks across loops.

    Args:
        bundle: the optimum without loops, of N poses and T points.
        loop_observations: (O,) observations of landmarks across loops; their tracks are those of the bundle.
        sigma: (2,) standard deviations of range_m and bearing_rad.
        vehicle_from_sonar: (4, 4) lever arm.
        correlation: correlation of the errors of one track's observations.

    Returns:
        (N, 4, 4) world_from_vehicle.
    """
    used = bundle.in_graph[loop_observations.track]
    if not used.any():
        return bundle.world_from_vehicle
    views = np.bincount(loop_observations.track, minlength=len(bundle.xyz_m))[loop_observations.track]
    sigmas = sigma * np.sqrt(1 + correlation * (views - 1))[:, None]
    values, poses, points = bundle.values, bundle.world_from_vehicle, bundle.xyz_m
    for _ in range(PASSES):
        residual = _residuals(loop_observations, poses, points, vehicle_from_sonar, sigma)
        inflation = max(1.0, float(np.median(residual[used])))
        graph = bundle.graph.clone()
        for index in np.flatnonzero(used).tolist():
            _add_observation(
                graph, loop_observations, index, inflation * sigmas[index], gtsam.Pose3(vehicle_from_sonar)
            )
        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setMaxIterations(MAX_ITERATIONS)
        parameters.setRelativeErrorTol(1e-4)
        values = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
        poses = np.stack([values.atPose3(FIRST_POSE + index).matrix() for index in range(len(poses))])
        points = points.copy()
        for track in np.unique(loop_observations.track[used]).tolist():
            points[track] = values.atPoint3(FIRST_POINT + track)
    return poses


def _add_observation(
    graph: gtsam.NonlinearFactorGraph, loop_observations: Tracks, index: int, sigma: FloatArray, lever_arm: gtsam.Pose3
) -> None:
    pose, point = FIRST_POSE + int(loop_observations.frame[index]), FIRST_POINT + int(loop_observations.track[index])
    graph.add(bearing_factor(pose, point, float(loop_observations.bearing_rad[index]), float(sigma[1]), lever_arm))
    graph.add(range_factor(pose, point, float(loop_observations.range_m[index]), float(sigma[0]), lever_arm))


def _residuals(
    loop_observations: Tracks,
    world_from_vehicle: FloatArray,
    xyz_m: FloatArray,
    vehicle_from_sonar: FloatArray,
    sigma: FloatArray,
) -> FloatArray:
    """Return the (O,) norms of the whitened range and bearing residuals of the loop observations."""
    sonar_from_world = invert(world_from_vehicle @ vehicle_from_sonar)[loop_observations.frame]
    range_m, bearing_rad, _ = project(transform(sonar_from_world, xyz_m[loop_observations.track]))
    difference_rad = angle_difference(bearing_rad, loop_observations.bearing_rad)
    return np.asarray(np.hypot((range_m - loop_observations.range_m) / sigma[0], difference_rad / sigma[1]))
