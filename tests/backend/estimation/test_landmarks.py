"""Landmarks of a solution: views, arcs, and elevation determined by roll but not by planar motion."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.estimation.landmarks import describe_landmarks
from asfm.backend.estimation.solution import Solution, solve_tracks
from asfm.backend.graph.marginal_covariance import measure_uncertainty
from asfm.config import BackendConfig, Config
from asfm.geometry.feature_noise import feature_sigma
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.sensor_constraints import sensor_constraints
from asfm.sequence import Sequence
from asfm.types import FloatArray, Landmarks, Tracks
from tests.worlds import make_constraints, no_frame

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (500, 128), np.deg2rad(20))
LEVER_ARM = make_pose(np.array([0.4, -0.1, -0.2]), Rotation.from_euler("ZYX", [0.1, 0.05, 0.0]))
INDEPENDENT = Config(backend=BackendConfig(track_correlation=0.0))


def _oscillate(roll_rad: float, frame_count: int = 10) -> FloatArray:
    """Make a planar path of the sonar with an oscillating roll of the given amplitude."""
    phase = np.linspace(0, 2 * np.pi, frame_count)
    angle_rad = np.column_stack([0.1 * np.sin(phase), np.zeros(frame_count), roll_rad * np.sin(2 * phase + 0.4)])
    place_m = np.column_stack([0.3 * np.sin(phase), 0.3 * np.cos(phase), np.zeros(frame_count)])
    return make_pose(place_m, Rotation.from_euler("ZYX", angle_rad))


def _points(seed: int, count: int = 40) -> FloatArray:
    spherical = np.random.default_rng(seed).uniform([3, -0.4, -0.08], [8, 0.4, 0.08], (count, 3))
    return back_project(*spherical.T)


def _describe_landmarks(solution: Solution, sequence: Sequence, config: Config) -> Landmarks:
    covariance_m2 = measure_uncertainty(solution.bundle, solution.elevation_information_ratio).point_m2
    return describe_landmarks(solution, covariance_m2, sequence, config)


def _describe(
    world_from_sonar: FloatArray, xyz_m: FloatArray, config: Config = INDEPENDENT
) -> tuple[Solution, Landmarks]:
    """Solve with exact odometry and noisy observations."""
    poses = world_from_sonar @ invert(LEVER_ARM)
    sequence = Sequence("simulated", SONAR, np.arange(len(poses), dtype=np.float64), no_frame, LEVER_ARM)
    seen = transform(invert(world_from_sonar), xyz_m[:, None])
    track, frame = np.nonzero(SONAR.sees(seen))
    range_m, bearing_rad, _ = project(seen[track, frame])
    sigma = feature_sigma(SONAR, config.noise)
    error = np.random.default_rng(1).normal(0, sigma, (len(track), 2))
    tracks = Tracks(track, frame, range_m + error[:, 0], bearing_rad + error[:, 1])
    sensors = sensor_constraints(
        sequence,
        read_navigation(sequence, config.backend),
        poses,
        np.tile([0.002, 0.005], (len(poses) - 1, 1)),
        measured=True,
    )
    solution = solve_tracks(tracks, sequence, poses, sensors, config)
    return solution, _describe_landmarks(solution, sequence, config)


@pytest.fixture(scope="module")
def rolling() -> tuple[Solution, Landmarks]:
    return _describe(_oscillate(0.5), _points(0))


def test_roll_determines_elevation_and_planar_motion_does_not(rolling: tuple[Solution, Landmarks]) -> None:
    _, flat = _describe(_oscillate(0.0), _points(0))
    assert len(flat) > 30 and not flat.well_constrained.any()
    off_axis = np.abs(_points(0)[rolling[1].track, 1]) > 0.5
    assert off_axis.sum() > 10 and rolling[1].well_constrained[off_axis].mean() > 0.9


def test_well_constrained_landmarks_are_within_their_sigmas(rolling: tuple[Solution, Landmarks]) -> None:
    _, landmarks = rolling
    error_m = np.linalg.norm(landmarks.xyz_m - _points(0)[landmarks.track], axis=1)
    good = landmarks.well_constrained
    assert good.sum() > 10
    assert np.all(error_m[good] < 4 * landmarks.sigma_m[good])


def test_sigma_is_the_largest_of_the_covariance(rolling: tuple[Solution, Landmarks]) -> None:
    _, landmarks = rolling
    expected = [np.sqrt(np.linalg.svd(covariance)[1][0]) for covariance in landmarks.covariance_m2]
    np.testing.assert_allclose(landmarks.sigma_m, expected, rtol=1e-9)


def test_views_are_the_used_observations(rolling: tuple[Solution, Landmarks]) -> None:
    solution, landmarks = rolling
    for track, views in zip(landmarks.track.tolist(), landmarks.views.tolist(), strict=True):
        assert views == np.sum(solution.observed & (solution.tracks.track == track))
    assert landmarks.views.min() >= INDEPENDENT.tracks.min_views


def test_arcs_are_those_of_the_last_observation(rolling: tuple[Solution, Landmarks]) -> None:
    solution, landmarks = rolling
    for track, arc_m in zip(landmarks.track.tolist(), landmarks.arc_m, strict=True):
        last = np.flatnonzero(solution.observed & (solution.tracks.track == track))[-1]
        pose = solution.bundle.world_from_vehicle[solution.tracks.frame[last]] @ LEVER_ARM
        range_m, bearing_rad, elevation_rad = project(transform(invert(pose), arc_m))
        np.testing.assert_allclose(range_m, solution.tracks.range_m[last], atol=1e-9)
        np.testing.assert_allclose(bearing_rad, solution.tracks.bearing_rad[last], atol=1e-9)
        np.testing.assert_allclose(elevation_rad[[0, -1]], np.deg2rad([-10, 10]), atol=1e-9)


def test_correlated_tracks_have_larger_sigmas(rolling: tuple[Solution, Landmarks]) -> None:
    """Under fully correlated errors n views count as one, so sigmas grow towards the root of n."""
    _, correlated = _describe(_oscillate(0.5), _points(0), Config(backend=BackendConfig(track_correlation=1.0)))
    _, independent = rolling
    np.testing.assert_array_equal(correlated.track, independent.track)
    growth = correlated.sigma_m / independent.sigma_m
    assert np.all(growth > 1.2) and np.all(growth < np.sqrt(independent.views) + 0.8)


def test_tracks_that_contradict_themselves_become_no_landmark() -> None:
    """Ten tracks whose ranges jump by metres, beside good ones."""
    poses, xyz_m = _oscillate(0.5), _points(2, 30)
    jumping = np.random.default_rng(3).uniform(1, 9, (len(poses), 10))
    seen = transform(invert(poses), xyz_m[:, None])
    range_m, bearing_rad, _ = project(seen)
    range_m[:10] = jumping.T
    track, frame = np.divmod(np.arange(range_m.size), len(poses))
    tracks = Tracks(track, frame, range_m.ravel(), bearing_rad.ravel())
    sequence = Sequence("simulated", SONAR, np.arange(len(poses), dtype=np.float64), no_frame)
    sensors = sensor_constraints(
        sequence,
        read_navigation(sequence, INDEPENDENT.backend),
        poses,
        np.tile([0.002, 0.005], (len(poses) - 1, 1)),
        measured=True,
    )
    solution = solve_tracks(tracks, sequence, poses, sensors, INDEPENDENT)
    landmarks = _describe_landmarks(solution, sequence, INDEPENDENT)
    assert np.mean(landmarks.track >= 10) > 0.9
    assert np.isin(np.arange(10, 30), landmarks.track).mean() > 0.9


def test_a_point_behind_one_of_the_frames_that_observe_it_is_no_landmark(rolling: tuple[Solution, Landmarks]) -> None:
    solution, landmarks = rolling
    turned = solution.bundle.world_from_vehicle.copy()
    turned[4] = turned[4] @ make_pose(np.zeros(3), Rotation.from_rotvec([0.0, 0.0, np.pi]))
    unseen = (solution.tracks.frame == 4) & (solution.tracks.track % 2 == 1)
    observed, bundle = solution.observed & ~unseen, replace(solution.bundle, world_from_vehicle=turned)
    sequence = Sequence("simulated", SONAR, np.arange(10, dtype=np.float64), no_frame, LEVER_ARM)
    kept = _describe_landmarks(replace(solution, observed=observed, bundle=bundle), sequence, INDEPENDENT).track
    behind = np.unique(solution.tracks.track[observed & (solution.tracks.frame == 4)])
    assert len(behind) > 10
    np.testing.assert_array_equal(kept, np.setdiff1d(landmarks.track, behind))


@pytest.mark.parametrize("side", [-1, 1])
def test_the_edge_of_the_beam_is_that_of_the_mounted_sonar(rolling: tuple[Solution, Landmarks], side: int) -> None:
    """The margin ends a few hundredths of a radian beyond the aperture, as the sonar sees it and not the vehicle."""
    solution, landmarks = rolling
    resting = np.repeat(solution.bundle.world_from_vehicle[:1], 10, axis=0)
    sequence = Sequence("simulated", SONAR, np.arange(10, dtype=np.float64), no_frame, LEVER_ARM)
    kept = []
    for elevation_rad in (SONAR.elevation_aperture_rad / 2 + 0.045, SONAR.elevation_aperture_rad / 2 + 0.055):
        in_sonar = back_project(np.array(5.0), np.array(0.0), side * elevation_rad)
        xyz_m = np.broadcast_to(transform(resting[0] @ LEVER_ARM, in_sonar), solution.bundle.xyz_m.shape)
        bundle = replace(solution.bundle, world_from_vehicle=resting, xyz_m=xyz_m)
        covariance_m2 = np.tile(np.eye(3), (len(xyz_m), 1, 1))
        kept.append(len(describe_landmarks(replace(solution, bundle=bundle), covariance_m2, sequence, INDEPENDENT)))
    assert kept == [int(solution.bundle.in_graph.sum()), 0] and len(landmarks)


def test_no_tracks_give_no_landmarks() -> None:
    poses = _oscillate(0.1, 3)
    sequence = Sequence("simulated", SONAR, np.arange(3, dtype=np.float64), no_frame)
    sensors = make_constraints(sequence, poses, np.full((2, 2), 0.01), measured=True, config=INDEPENDENT.backend)
    nothing = Tracks(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
    solution = solve_tracks(nothing, sequence, poses, sensors, INDEPENDENT)
    landmarks = _describe_landmarks(solution, sequence, INDEPENDENT)
    assert len(landmarks) == 0 and landmarks.covariance_m2.shape == (0, 3, 3) and landmarks.arc_m.shape[0] == 0
    np.testing.assert_allclose(solution.bundle.world_from_vehicle, poses, atol=1e-6)


@pytest.mark.parametrize("place_m", [(-5.0, 0.0, 0.0), (4.0, 0.0, 3.0)])
def test_points_outside_their_beams_are_no_landmarks(
    rolling: tuple[Solution, Landmarks], place_m: tuple[float, float, float]
) -> None:
    solution, landmarks = rolling
    xyz_m = solution.bundle.xyz_m.copy()
    outside = int(landmarks.track[3])
    xyz_m[outside] = place_m
    spoiled = replace(solution, bundle=replace(solution.bundle, xyz_m=xyz_m))
    sequence = Sequence("simulated", SONAR, np.arange(10, dtype=np.float64), no_frame, LEVER_ARM)
    kept = _describe_landmarks(spoiled, sequence, INDEPENDENT).track
    np.testing.assert_array_equal(kept, np.delete(landmarks.track, 3))


def test_arcs_are_those_of_the_last_observation_that_was_used() -> None:
    """The last observation of each track is left out of the solution."""
    solution, full = _describe(_oscillate(0.4), _points(0))
    sequence = Sequence("simulated", SONAR, np.arange(10, dtype=np.float64), no_frame, LEVER_ARM)
    last = np.diff(solution.tracks.track, append=-1) != 0
    found = _describe_landmarks(replace(solution, observed=solution.observed & ~last), sequence, INDEPENDENT)
    tracks = solution.tracks
    for row, track in enumerate(found.track.tolist()):
        used = np.flatnonzero((tracks.track == track) & solution.observed & ~last)[-1]
        pose = solution.bundle.world_from_vehicle[tracks.frame[used]] @ LEVER_ARM
        arc_m = transform(
            pose, SONAR.elevation_arc(tracks.range_m[used], tracks.bearing_rad[used], full.arc_m.shape[1])
        )
        np.testing.assert_allclose(found.arc_m[row], arc_m, atol=1e-9)
