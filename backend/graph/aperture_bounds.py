"""Elevation-aperture constraints on points: violated bounds, clamping, and a prior on the elevation."""

import gtsam
import numpy as np

from asfm.backend.graph.factors import elevation_factor
from asfm.backend.graph.problem import FIRST_POINT, FIRST_POSE, BundleProblem
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import back_project, project
from asfm.types import BoolArray, FloatArray

EDGE_RAD = 0.01
"""Standard deviation of the elevation at the edge of the aperture: beams do not end sharply."""
MAX_OUTSIDE_RAD = 0.2
"""Points farther outside the aperture than this get a position prior, because their elevation may be singular."""
MIN_RANGE_M = 1e-3
"""Lower bound of the sigma of that position prior."""


def aperture_violations(
    problem: BundleProblem, world_from_vehicle: FloatArray, xyz_m: FloatArray
) -> tuple[BoolArray, FloatArray]:
    """Find the observations whose point lies outside the elevation aperture: the active set of the bounds.

    Args:
        problem: O observations of T tracks.
        world_from_vehicle: (N, 4, 4) poses.
        xyz_m: (T, 3) points in the world frame.

    Returns:
        (O,) whether the bound is violated by a used observation, and (O,) elevation_rad of the nearest edge.
    """
    elevation_rad = observed_elevations(problem, world_from_vehicle, xyz_m)
    outside = problem.observed & (np.abs(elevation_rad) > problem.half_aperture_rad)
    return outside, np.copysign(problem.half_aperture_rad, elevation_rad)


def clamp_to_aperture(problem: BundleProblem, world_from_vehicle: FloatArray, xyz_m: FloatArray) -> FloatArray:
    """Move the points outside the elevation aperture to its edge.

    A point that several frames see outside is moved in the frame where it lies farthest outside.

    Args:
        problem: O observations of T tracks.
        world_from_vehicle: (N, 4, 4) poses.
        xyz_m: (T, 3) points in the world frame.

    Returns:
        (T, 3) points in the world frame; range and bearing in that frame are unchanged.
    """
    world_from_sonar = (world_from_vehicle @ problem.vehicle_from_sonar)[problem.tracks.frame]
    range_m, bearing_rad, elevation_rad = project(transform(invert(world_from_sonar), xyz_m[problem.tracks.track]))
    beyond = np.where(problem.observed, np.abs(elevation_rad) - problem.half_aperture_rad, 0.0)
    order = np.argsort(beyond, kind="stable")
    order = order[beyond[order] > 0]
    edge_rad = np.copysign(problem.half_aperture_rad, elevation_rad[order])
    clamped = xyz_m.copy()
    # ascending order: of several assignments to one point the last one, the farthest outside, remains
    clamped[problem.tracks.track[order]] = transform(
        world_from_sonar[order], back_project(range_m[order], bearing_rad[order], edge_rad)
    )
    return clamped


def middle_observations(problem: BundleProblem) -> BoolArray:
    """Select the middle one of the used observations of each track: (O,) bool."""
    used = np.flatnonzero(problem.observed)
    first = np.flatnonzero(np.diff(problem.tracks.track[used], prepend=-1))
    stop = np.append(first[1:], len(used))
    selected = np.zeros(len(problem.tracks), dtype=bool)
    selected[used[(first + stop - 1) // 2]] = True
    return selected


def add_elevation_factors(
    graph: gtsam.NonlinearFactorGraph,
    problem: BundleProblem,
    selected: BoolArray,
    elevation_rad: FloatArray,
    sigma_rad: float,
) -> None:
    """Add factors on the elevation at which selected observations see their points.

    Args:
        graph: is changed in place.
        problem: O observations of T tracks.
        selected: (O,) which observations get a factor.
        elevation_rad: (O,) the elevation that each factor states.
        sigma_rad: standard deviation of the elevation.
    """
    tracks = problem.tracks
    lever_arm = gtsam.Pose3(problem.vehicle_from_sonar)
    for index in np.flatnonzero(selected).tolist():
        pose, point = FIRST_POSE + int(tracks.frame[index]), FIRST_POINT + int(tracks.track[index])
        bearing_rad, target_rad = float(tracks.bearing_rad[index]), float(elevation_rad[index])
        graph.add(elevation_factor(pose, point, bearing_rad, target_rad, sigma_rad, lever_arm))


def add_aperture_priors(
    graph: gtsam.NonlinearFactorGraph, problem: BundleProblem, world_from_vehicle: FloatArray, xyz_m: FloatArray
) -> None:
    """Add one prior per point that it lies in the elevation aperture, for covariances.

    An elevation that is uniform over the aperture has the standard deviation half aperture / sqrt(3). Each prior has
    its mean at the given estimate, so it adds information without moving the optimum. A point far outside the
    aperture, where the elevation may be singular, gets a position prior with its range as sigma instead.

    Args:
        graph: is changed in place.
        problem: O observations of T tracks.
        world_from_vehicle: (N, 4, 4) poses at the optimum.
        xyz_m: (T, 3) points at the optimum, world frame.
    """
    used = np.flatnonzero(problem.observed)
    last = used[np.flatnonzero(np.diff(problem.tracks.track[used], append=-1))]
    selected = np.zeros(len(problem.tracks), dtype=bool)
    selected[last] = True
    elevation_rad = observed_elevations(problem, world_from_vehicle, xyz_m)
    inside = np.abs(elevation_rad) <= problem.half_aperture_rad + MAX_OUTSIDE_RAD
    add_elevation_factors(graph, problem, selected & inside, elevation_rad, problem.half_aperture_rad / np.sqrt(3))
    for index in np.flatnonzero(selected & ~inside).tolist():
        noise = gtsam.noiseModel.Isotropic.Sigma(3, max(float(problem.tracks.range_m[index]), MIN_RANGE_M))
        track = int(problem.tracks.track[index])
        graph.add(gtsam.PriorFactorPoint3(FIRST_POINT + track, xyz_m[track], noise))


def observed_elevations(problem: BundleProblem, world_from_vehicle: FloatArray, xyz_m: FloatArray) -> FloatArray:
    """Compute the elevation at which the frame of each observation sees its point.

    Args:
        problem: O observations of T tracks.
        world_from_vehicle: (N, 4, 4) poses.
        xyz_m: (T, 3) points in the world frame.

    Returns:
        (O,) elevation_rad in the sonar frame.
    """
    sonar_from_world = invert(world_from_vehicle @ problem.vehicle_from_sonar)[problem.tracks.frame]
    return project(transform(sonar_from_world, xyz_m[problem.tracks.track]))[2]
