"""A solved world for the tests of diagnostics: a vehicle over an uneven floor, with odometry, depth and attitude."""

from dataclasses import replace

import numpy as np

from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.bundle_adjustment import adjust_bundle
from asfm.backend.graph.problem import BundleProblem
from asfm.config import BackendConfig
from asfm.geometry.poses import interpolate, transform
from asfm.geometry.sonar import back_project
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.sensor_constraints import sensor_constraints
from asfm.sequence import Sequence
from asfm.types import Tracks
from tests.worlds import make_vehicle_path, make_vehicle_sequence, observe_floor


def solve_vehicle(sequence: Sequence | None = None, tracks: Tracks | None = None, navigation: bool = True) -> Solution:
    """Adjust the poses and points of a sequence of the vehicle's path, starting near the truth.

    Args:
        sequence: its odometry, depth and attitude are used; a right one by default.
        tracks: observations; right ones by default.
        navigation: whether depth and attitude are used.
    """
    sequence = sequence or make_vehicle_sequence()
    tracks = select_long(tracks or observe_floor())
    read = read_navigation(sequence, BackendConfig(use_navigation=navigation))
    assert sequence.odometry is not None
    odometry = sequence.odometry
    steps = interpolate(odometry.timestamps_s, odometry.world_from_vehicle, sequence.timestamps_s)
    noise = sequence.noise
    step_sigma = np.tile([noise.odometry_rotation_rad, noise.odometry_translation_m], (len(sequence) - 1, 1))
    sensors = sensor_constraints(sequence, read, steps, step_sigma, True)
    sigma = np.tile([0.015, 0.005], (len(tracks), 1))
    mount, half_rad = sequence.vehicle_from_sonar, sequence.sonar.elevation_aperture_rad / 2
    problem = BundleProblem(tracks, np.ones(len(tracks), dtype=bool), sigma, sensors, mount, half_rad)
    poses = make_vehicle_path()
    first = np.flatnonzero(np.diff(tracks.track, prepend=-1))
    middle = transform(
        (poses @ mount)[tracks.frame[first]], back_project(tracks.range_m[first], tracks.bearing_rad[first], 0.0)
    )
    bundle = adjust_bundle(problem, poses, middle, 1e-9)
    return Solution(tracks, problem.observed, bundle, problem, np.ones(tracks.count))


def select_long(tracks: Tracks, views: int = 8) -> Tracks:
    """Return the tracks with enough views to be points, and not too many for a quick test."""
    counts = np.bincount(tracks.track)
    kept = np.flatnonzero(counts >= views)[::6]
    return tracks.select(np.isin(tracks.track, kept))


def with_range_error(tracks: Tracks, scale: float = 1.0, bias_m: float = 0.0) -> Tracks:
    """Return tracks whose ranges are stated too long."""
    return replace(tracks, range_m=scale * tracks.range_m + bias_m)
