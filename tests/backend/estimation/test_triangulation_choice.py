"""Choice of a track's elevation in triangulation: arcs searched, cost of an outlier, weight of the prior."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.estimation.triangulation import (
    ELEVATION_PRIOR_SIGMAS,
    Gate,
    _Observations,
    _refine,
    triangulate_tracks,
    whitened_residuals,
)
from asfm.geometry.poses import invert, make_pose, transform, wrap_angle
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.types import FloatArray, Tracks

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (500, 128), np.deg2rad(20))
HALF_RAD = SONAR.elevation_aperture_rad / 2
GATE = Gate(HALF_RAD, edge_rad=0.02)
SIGMA = np.array([0.01, 0.005])


def observe(poses: FloatArray, xyz_m: FloatArray) -> Tracks:
    """Let every frame observe one point exactly."""
    range_m, bearing_rad, _ = project(transform(invert(poses), xyz_m))
    return Tracks(np.zeros(len(poses), int), np.arange(len(poses)), range_m, bearing_rad)


def rolled_poses(roll_rad: FloatArray) -> FloatArray:
    """Make poses at one place that differ in roll, which determines the elevation."""
    return make_pose(np.zeros((len(roll_rad), 3)), Rotation.from_rotvec(np.outer(roll_rad, [1.0, 0.0, 0.0])))


def triangulate(tracks: Tracks, poses: FloatArray, sigma: FloatArray = SIGMA) -> FloatArray:
    return np.asarray(triangulate_tracks(tracks, poses, SONAR, np.tile(sigma, (len(tracks), 1)), GATE).xyz_m[0])


def point_at(elevation_share: float) -> FloatArray:
    return back_project(np.array(5.0), np.array(0.0), elevation_share * HALF_RAD)


@pytest.mark.parametrize("right", [0, 3, 6])
def test_one_right_observation_among_the_first_the_middle_and_the_last_suffices(right: int) -> None:
    poses, low = rolled_poses(np.linspace(-0.6, 0.6, 7)), point_at(-0.7)
    exact, wrong = observe(poses, low), np.isin(np.arange(7), list({0, 3, 5, 6} - {right}))
    range_m = exact.range_m + wrong * np.linspace(1.0, 2.0, 7)
    found_m = triangulate(Tracks(exact.track, exact.frame, range_m, exact.bearing_rad), poses)
    np.testing.assert_allclose(found_m, low, atol=0.01)


def test_bearings_are_compared_in_their_own_sigmas() -> None:
    """Ranges say nothing about the elevation of a point seen from one place; precise bearings do."""
    poses, low = rolled_poses(np.linspace(-0.6, 0.6, 7)), point_at(-0.7)
    np.testing.assert_allclose(triangulate(observe(poses, low), poses, np.array([1.0, 0.005])), low, atol=0.05)


def test_an_inlier_costs_its_square_up_to_the_truncation() -> None:
    """Four views within 1.9 sigmas of a low point outweigh three exact ones of a high point: 14 + 18 < 36."""
    poses, (low, high) = rolled_poses(np.linspace(-0.6, 0.6, 7)), (point_at(-0.7), point_at(0.7))
    of_high = np.isin(np.arange(7), [0, 6])
    noise_rad = 1.9 * SIGMA[1] * np.array([0, 1, -1, 0, -1, 1, 0])
    bearing_rad = np.where(of_high, observe(poses, high).bearing_rad, observe(poses, low).bearing_rad + noise_rad)
    tracks = Tracks(np.zeros(7, int), np.arange(7), np.full(7, 5.0), bearing_rad)
    np.testing.assert_allclose(triangulate(tracks, poses), low, atol=0.05)


def test_the_prior_counts_once_a_track_and_not_once_a_view() -> None:
    """One lifted frame tells a point from its reflection, which more frames see nearer to the middle."""
    y_m, z_m = np.concatenate([np.linspace(-2.5, 2.5, 6), np.zeros(201)]), np.append(np.zeros(206), 0.1)
    pitch_rad = np.concatenate([np.zeros(6), np.full(200, -0.28 * HALF_RAD), [0.0]])
    rotation = Rotation.from_rotvec(np.outer(pitch_rad, [0.0, 1.0, 0.0]))
    poses, below = make_pose(np.stack([0 * y_m, y_m, z_m], axis=1), rotation), point_at(-0.7)
    np.testing.assert_allclose(triangulate(observe(poses, below), poses), below, atol=0.02)


def test_the_elevation_is_the_mean_of_data_and_prior_by_their_information() -> None:
    """With I the information of small rolls and P that of the prior, the share I / (I + P) is left."""
    count, sigma = 60, np.array([0.5, 0.2])
    roll_rad = 0.06 * np.linspace(-1, 1, count)
    poses, low = rolled_poses(roll_rad), point_at(-0.7)
    information = np.sum((np.sin(roll_rad) / sigma[1]) ** 2)
    share = information / (information + (ELEVATION_PRIOR_SIGMAS / HALF_RAD) ** 2)
    assert 0.3 < share < 0.7
    elevation_rad = project(triangulate(observe(poses, low), poses, sigma))[2]
    assert elevation_rad / (-0.7 * HALF_RAD) == pytest.approx(share, rel=0.05)


def test_bearing_residuals_take_the_short_way_round() -> None:
    """A point straight astern of a sonar that sees all around lies at pi for one frame and at -pi for the next."""
    astern = back_project(np.array([4.0]), np.array([np.pi - 0.01]), 0.0)
    tracks = Tracks(np.zeros(1, int), np.zeros(1, int), np.full(1, 4.0), np.full(1, -np.pi + 0.01))
    residual, _ = whitened_residuals(astern, tracks, np.eye(4)[None], SIGMA[None])
    np.testing.assert_allclose(residual, [[0.0, -0.02 / SIGMA[1]]], atol=1e-9)


def test_a_track_across_the_cut_behind_the_sonar_gives_the_same_point() -> None:
    """Triangulation of a point astern agrees with that of the same views turned by half a turn."""
    around = SonarModel.evenly_spaced("all around", (0.5, 10.0), (-np.pi, np.pi), (500, 512), 2 * HALF_RAD)
    y_m = np.linspace(-0.2, 0.2, 8)
    rotation = Rotation.from_rotvec(np.outer(np.linspace(-0.5, 0.4, 8), [1.0, 0.0, 0.0]))
    ahead = make_pose(np.stack([0 * y_m, y_m, 0.1 * y_m], axis=1), rotation)
    astern = ahead @ make_pose(np.zeros(3), Rotation.from_rotvec([0.0, 0.0, np.pi]))
    sigma, noise_rad = np.tile(SIGMA, (8, 1)), 0.008 * np.resize([1, -1, -1, 1], 8)
    found = []
    for poses in (ahead, astern):
        exact = observe(poses, point_at(-0.6))
        bearing_rad = wrap_angle(exact.bearing_rad + noise_rad)
        noisy = Tracks(exact.track, exact.frame, exact.range_m, bearing_rad)
        found.append(triangulate_tracks(noisy, poses, around, sigma, GATE))
    assert np.ptp(bearing_rad) > 6
    assert np.any(np.abs(bearing_rad - exact.bearing_rad) > 6)
    assert found[1].inlier.all()
    np.testing.assert_allclose(found[1].xyz_m, found[0].xyz_m, atol=1e-6)
    np.testing.assert_allclose(found[1].xyz_m[0], point_at(-0.6), atol=0.05)


@pytest.mark.parametrize(("away_m", "moved_m"), [(0.3, 0.3), (8.0, 1.0)])
def test_a_step_of_the_refinement_is_at_most_a_fifth_of_the_range(away_m: float, moved_m: float) -> None:
    """The point lies too far along the beam, in which a full step would bring it back at once."""
    poses = make_pose(np.array([[0.0, 0.0, 0.0], [0.0, 0.1, 0.0]]), Rotation.from_rotvec([[0, 0, 0], [0.4, 0, 0]]))
    point, sigma = np.array([[5.0, 0.0, 0.0]]), np.tile([0.01, 0.005], (2, 1))
    range_m, bearing_rad, _ = project(transform(invert(poses), point))
    tracks = Tracks(np.zeros(2, dtype=np.int64), np.arange(2), range_m, bearing_rad)
    observations = _Observations(tracks, np.zeros(1, dtype=np.int64), poses, invert(poses), sigma, Gate(0.2, 0.02))
    moved = _refine(point + away_m * np.eye(3)[:1], observations, np.ones(2, dtype=bool)) - point
    np.testing.assert_allclose(moved, [[away_m - moved_m, 0.0, 0.0]], atol=0.04)
