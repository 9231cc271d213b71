"""Landmarks of a solution: position, covariance, number of views and elevation arc."""

import numpy as np

from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.aperture_bounds import EDGE_RAD
from asfm.config import Config
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import project
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, IntArray, Landmarks, Tracks

ARC_POINTS = 9
"""Points at which an elevation arc is sampled."""
APERTURE_MARGIN_SIGMAS = 5
"""Points may lie outside the elevation aperture by this many sigmas of its edge, where beams fade."""


def describe_landmarks(solution: Solution, covariance_m2: FloatArray, sequence: Sequence, config: Config) -> Landmarks:
    """Describe the landmarks of a solution with covariance, number of views and elevation arc.

    A landmark is well constrained when its largest sigma is a small share of half its elevation arc: the motion
    determines the elevation much better than the aperture of the beam does.

    Args:
        solution: poses and points.
        covariance_m2: (T, 3, 3) covariances of the points, world frame.
        sequence: gives the sonar and its lever arm.
        config: section ``backend``.
    """
    tracks = solution.tracks
    track = np.flatnonzero(solution.bundle.in_graph & ~_outside_aperture(solution, sequence))
    covariance = covariance_m2[track]
    sigma_m = np.sqrt(np.linalg.eigvalsh(covariance)[:, -1]) if len(track) else np.zeros(0)
    last = _last_observations(tracks, solution)[track]
    half_arc_m = tracks.range_m[last] * sequence.sonar.elevation_aperture_rad / 2
    return Landmarks(
        track=track,
        xyz_m=solution.bundle.xyz_m[track],
        covariance_m2=covariance,
        sigma_m=sigma_m,
        views=np.bincount(tracks.track[solution.observed], minlength=tracks.count)[track],
        well_constrained=sigma_m <= config.backend.well_constrained_share * half_arc_m,
        arc_m=_world_arcs(tracks, last, sequence, solution.bundle.world_from_vehicle),
    )


def _outside_aperture(solution: Solution, sequence: Sequence) -> BoolArray:
    """Return which (T,) tracks have a point that lies behind, or clearly above or below, a beam that observes it."""
    tracks, used = solution.tracks, solution.observed
    sonar_from_world = invert(solution.bundle.world_from_vehicle @ sequence.vehicle_from_sonar)[tracks.frame[used]]
    in_sonar = transform(sonar_from_world, solution.bundle.xyz_m[tracks.track[used]])
    _, bearing_rad, elevation_rad = project(in_sonar)
    behind = np.cos(bearing_rad - tracks.bearing_rad[used]) <= 0
    outside = np.abs(elevation_rad) > sequence.sonar.elevation_aperture_rad / 2 + APERTURE_MARGIN_SIGMAS * EDGE_RAD
    return np.bincount(tracks.track[used], behind | outside, minlength=tracks.count) > 0


def _last_observations(tracks: Tracks, solution: Solution) -> IntArray:
    """Return the (T,) index of each track's last used observation; observations are sorted by track and frame."""
    last = np.zeros(tracks.count, dtype=np.int64)
    used = np.flatnonzero(solution.observed)
    last[tracks.track[used]] = used
    return last


def _world_arcs(tracks: Tracks, last: IntArray, sequence: Sequence, world_from_vehicle: FloatArray) -> FloatArray:
    """Return the (K, ARC_POINTS, 3) elevation arcs, world frame, of the (K,) last observations."""
    arc = sequence.sonar.elevation_arc(tracks.range_m[last], tracks.bearing_rad[last], ARC_POINTS)
    world_from_sonar = world_from_vehicle[tracks.frame[last]] @ sequence.vehicle_from_sonar
    return transform(world_from_sonar[:, None], arc)
