"""What the beam says of points: sonars see nothing outside their elevation aperture."""

import gtsam
import numpy as np

from asfm.backend.graph.factors import elevation_factor
from asfm.backend.graph.problem import FIRST_POINT, FIRST_POSE, BundleProblem
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import back_project, project
from asfm.types import BoolArray, FloatArray

EDGE_RAD = 0.01
"""Standard deviation of the elevation beyond the edge of the aperture: beams do not end sharply."""
LOST_RAD = 0.2
"""How far outside the aperture a point counts as lost."""
SMALLEST_RANGE_M = 1e-3


def aperture_violations(
    problem: BundleProblem, world_from_vehicle: FloatArray, xyz_m: FloatArray
) -> tuple[BoolArray, FloatArray]:
    """Tell which observations see their point outside the aperture: (O,), and (O,) elevation_rad of the edge there."""
    elevation_rad = observed_elevations(problem, world_from_vehicle, xyz_m)
    outside = problem.observed & (np.abs(elevation_rad) > problem.half_aperture_rad)
    return outside, np.copysign(problem.half_aperture_rad, elevation_rad)


def clamp_to_aperture(problem: BundleProblem, world_from_vehicle: FloatArray, xyz_m: FloatArray) -> FloatArray:
    """Move points that have left the beam to its edge, as the frame sees them that they have left farthest: (T, 3)."""
    world_from_sonar = (world_from_vehicle @ problem.vehicle_from_sonar)[problem.tracks.frame]
    range_m, bearing_rad, elevation_rad = project(transform(invert(world_from_sonar), xyz_m[problem.tracks.track]))
    beyond = np.where(problem.observed, np.abs(elevation_rad) - problem.half_aperture_rad, 0.0)
    order = np.argsort(beyond, kind="stable")
    order = order[beyond[order] > 0]
    edge_rad = np.copysign(problem.half_aperture_rad, elevation_rad[order])
    inside = xyz_m.copy()
    inside[problem.tracks.track[order]] = transform(
        world_from_sonar[order], back_project(range_m[order], bearing_rad[order], edge_rad)
    )
    return inside


def middle_observations(problem: BundleProblem) -> BoolArray:
    """Mark the middle one of each track's used observations: (O,)."""
    used = np.flatnonzero(problem.observed)
    first = np.flatnonzero(np.diff(problem.tracks.track[used], prepend=-1))
    stop = np.append(first[1:], len(used))
    chosen = np.zeros(len(problem.tracks), dtype=bool)
    chosen[used[(first + stop - 1) // 2]] = True
    return chosen


def add_elevation_factors(
    graph: gtsam.NonlinearFactorGraph,
    problem: BundleProblem,
    pulled: BoolArray,
    elevation_rad: FloatArray,
    sigma_rad: float,
) -> None:
    """Pull the points of the chosen (O,) observations to (O,) elevations."""
    tracks = problem.tracks
    lever_arm = gtsam.Pose3(problem.vehicle_from_sonar)
    for index in np.flatnonzero(pulled).tolist():
        pose, point = FIRST_POSE + int(tracks.frame[index]), FIRST_POINT + int(tracks.track[index])
        beam, target = float(tracks.bearing_rad[index]), float(elevation_rad[index])
        graph.add(elevation_factor(pose, point, beam, target, sigma_rad, lever_arm))


def add_aperture_priors(
    graph: gtsam.NonlinearFactorGraph, problem: BundleProblem, world_from_vehicle: FloatArray, xyz_m: FloatArray
) -> None:
    """State once a point that it lies in the beam: a uniform elevation has the sigma half aperture / sqrt(3).

    The factors rest at the optimum, so they tell covariances and move nothing. A point that has left the beam all the
    same, maybe to where elevations are singular, is told instead that it lies within its range of where it is.
    """
    used = np.flatnonzero(problem.observed)
    last = used[np.flatnonzero(np.diff(problem.tracks.track[used], append=-1))]
    chosen = np.zeros(len(problem.tracks), dtype=bool)
    chosen[last] = True
    elevation_rad = observed_elevations(problem, world_from_vehicle, xyz_m)
    inside = np.abs(elevation_rad) <= problem.half_aperture_rad + LOST_RAD
    add_elevation_factors(graph, problem, chosen & inside, elevation_rad, problem.half_aperture_rad / np.sqrt(3))
    for index in np.flatnonzero(chosen & ~inside).tolist():
        noise = gtsam.noiseModel.Isotropic.Sigma(3, max(float(problem.tracks.range_m[index]), SMALLEST_RANGE_M))
        track = int(problem.tracks.track[index])
        graph.add(gtsam.PriorFactorPoint3(FIRST_POINT + track, xyz_m[track], noise))


def observed_elevations(problem: BundleProblem, world_from_vehicle: FloatArray, xyz_m: FloatArray) -> FloatArray:
    """Elevation_rad at which each observation's frame sees its point: (O,)."""
    sonar_from_world = invert(world_from_vehicle @ problem.vehicle_from_sonar)[problem.tracks.frame]
    return project(transform(sonar_from_world, xyz_m[problem.tracks.track]))[2]
