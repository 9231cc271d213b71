"""Closing loops: poses that bring the two sightings of each landmark together, before tracks are joined across a loop.

The halves of a landmark that drift has pulled apart would not pass as one track. So the graph of the last round gets
the loops' matches as further observations, of the landmark by the frame that found it again, and is optimised from
where it is: first with sigmas as wide as the loops are open, then with their own.
"""

import gtsam
import numpy as np

from asfm.backend.graph.bundle_adjustment import Bundle
from asfm.backend.graph.factors import bearing_factor, range_factor
from asfm.backend.graph.problem import FIRST_POINT, FIRST_POSE
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import project
from asfm.types import FloatArray, Tracks

STEPS = 8
"""Iterations of each of the optimisations; the next round of adjustment goes on from there."""


def close_loops(
    bundle: Bundle, loop_observations: Tracks, sigma: FloatArray, vehicle_from_sonar: FloatArray, correlation: float
) -> FloatArray:
    """Optimise the poses under landmarks seen loop_observations: (N, 4, 4) world_from_vehicle.

    Args:
        bundle: the optimum without loops.
        loop_observations: observations, by frames that found landmarks again; the tracks are the bundle's.
        sigma: (2,) standard deviations of range_m and bearing_rad.
        vehicle_from_sonar: (4, 4).
        correlation: of the errors of one track's observations.
    """
    seen = bundle.in_graph[loop_observations.track]
    if not seen.any():
        return bundle.world_from_vehicle
    views = np.bincount(loop_observations.track, minlength=len(bundle.xyz_m))[loop_observations.track]
    sigmas = sigma * np.sqrt(1 + correlation * (views - 1))[:, None]
    values, poses, points = bundle.values, bundle.world_from_vehicle, bundle.xyz_m
    for _ in range(2):
        wide = max(1.0, float(np.median(_residuals(loop_observations, poses, points, vehicle_from_sonar, sigma)[seen])))
        graph = bundle.graph.clone()
        for index in np.flatnonzero(seen).tolist():
            _add_sighting(graph, loop_observations, index, wide * sigmas[index], gtsam.Pose3(vehicle_from_sonar))
        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setMaxIterations(STEPS)
        parameters.setRelativeErrorTol(1e-4)
        values = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
        poses = np.stack([values.atPose3(FIRST_POSE + index).matrix() for index in range(len(poses))])
        points = points.copy()
        for track in np.unique(loop_observations.track[seen]).tolist():
            points[track] = values.atPoint3(FIRST_POINT + track)
    return poses


def _add_sighting(
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
    """Tell how many sigmas (O,) each sighting is from its landmark."""
    sonar_from_world = invert(world_from_vehicle @ vehicle_from_sonar)[loop_observations.frame]
    range_m, bearing_rad, _ = project(transform(sonar_from_world, xyz_m[loop_observations.track]))
    return np.asarray(
        np.hypot(
            (range_m - loop_observations.range_m) / sigma[0], (bearing_rad - loop_observations.bearing_rad) / sigma[1]
        )
    )
