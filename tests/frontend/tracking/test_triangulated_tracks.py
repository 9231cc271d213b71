"""Triangulated tracks: inliers, point covariances and predicted observations against plain loops and sampling."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.spatial.transform import Rotation

from asfm.frontend.tracking.triangulated_tracks import (
    APERTURE_MARGIN_RAD,
    SIGMA_SCALE,
    TriangulatedTracks,
    predict_observations,
)
from asfm.geometry.feature_noise import feature_sigma
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, project
from asfm.types import FloatArray
from tests.frontend.tracking.landmark_scene import (
    ALL_AROUND,
    CONFIG,
    FRAMES,
    MIDDLE,
    POINTS,
    SONAR,
    make_scene,
    one_track_per_point,
    turn_astern,
    without_frame,
)
from tests.worlds import range_bearing

WINDOW = 16


def observed(triangulated: TriangulatedTracks, observation: int, xyz_m: FloatArray) -> FloatArray:
    """Return range_m, bearing_rad and elevation_rad of a world point in the frame of an observation."""
    pose = triangulated.world_from_sonar[triangulated.tracks.frame[observation]]
    return np.array(project(transform(invert(pose), xyz_m)))


def test_displaced_observations_are_outliers() -> None:
    displaced = np.arange(POINTS) < 25
    triangulated = make_scene().displace(displaced).triangulate(one_track_per_point())
    wrong = (triangulated.tracks.frame == MIDDLE) & displaced[triangulated.tracks.track]
    np.testing.assert_array_equal(triangulated.inlier[wrong], False)
    assert triangulated.inlier[~wrong].mean() > 0.98


@pytest.mark.parametrize(("scale", "inlier"), [(0.98, True), (1.02, False)])
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, -1.0), (0.6, 0.8)])
def test_the_gate_is_an_ellipse_of_scaled_sigmas(scale: float, inlier: bool, direction: tuple[float, float]) -> None:
    triangulated = make_scene(noise=0.0).triangulate(one_track_per_point())
    radius = scale * CONFIG.matching.arc_gate * SIGMA_SCALE
    offset = radius * np.array(direction) * feature_sigma(SONAR, CONFIG.noise)
    tracks = triangulated.tracks
    moved = replace(tracks, range_m=tracks.range_m + offset[0], bearing_rad=tracks.bearing_rad + offset[1])
    assert triangulated.inlier.mean() > 0.99
    np.testing.assert_array_equal(replace(triangulated, tracks=moved).inlier, triangulated.inlier & inlier)


def test_observations_of_points_that_are_missing_or_outside_the_aperture_are_outliers() -> None:
    scene = make_scene(noise=0.0)
    triangulated = scene.triangulate(one_track_per_point())
    without = replace(triangulated, has_point=np.arange(POINTS) != 7)
    np.testing.assert_array_equal(without.inlier, triangulated.inlier & (triangulated.tracks.track != 7))
    assert np.sum(triangulated.inlier & ~without.inlier) > 5
    tracks = triangulated.tracks.track.tolist()
    elevation_rad = np.array([observed(triangulated, o, scene.xyz_m[track])[2] for o, track in enumerate(tracks)])
    for aperture_rad in (SONAR.elevation_aperture_rad, 0.02):
        inlier = replace(triangulated, sonar=replace(SONAR, elevation_aperture_rad=aperture_rad)).inlier
        np.testing.assert_array_equal(inlier, np.abs(elevation_rad) <= aperture_rad / 2 + APERTURE_MARGIN_RAD)
        assert 0 < inlier.mean() < 1


def test_covariances_are_the_inverse_information_of_the_inliers_and_one_aperture_prior() -> None:
    """Numerical Jacobians, one observation at a time; the displaced observations add nothing."""
    triangulated = make_scene().displace(np.arange(POINTS) < 25).triangulate(one_track_per_point())
    sigma = SIGMA_SCALE * feature_sigma(SONAR, CONFIG.noise)
    for track in (3, 30):
        inliers = np.flatnonzero((triangulated.tracks.track == track) & triangulated.inlier)
        assert len(inliers) >= FRAMES - 2 and (MIDDLE in triangulated.tracks.frame[inliers]) == (track == 30)
        information = np.zeros((3, 3))
        for observation in inliers.tolist():
            jacobian = approx_fprime(
                triangulated.xyz_m[track], lambda xyz_m, index=observation: observed(triangulated, index, xyz_m), 1e-7
            )
            prior_rad = 0.5 * SONAR.elevation_aperture_rad
            weight = np.array([*(1 / sigma**2), 1 / prior_rad**2 / len(inliers)])
            information += jacobian.T @ np.diag(weight) @ jacobian
        np.testing.assert_allclose(triangulated.covariance_m2[track], np.linalg.inv(information), rtol=1e-3, atol=1e-7)


def test_stated_sigmas_below_the_default_are_raised_to_it() -> None:
    triangulated = make_scene().triangulate(one_track_per_point())
    default = feature_sigma(SONAR, CONFIG.noise)
    stated = np.tile([0.1 * default[0], 3 * default[1]], (len(triangulated.tracks), 1))
    sigma = replace(triangulated, tracks=replace(triangulated.tracks, sigma=stated)).sigma
    np.testing.assert_allclose(sigma, np.tile([default[0], 3 * default[1]], (len(stated), 1)))


@pytest.mark.parametrize("window", [1, 2, WINDOW])
def test_predictions_are_of_points_with_an_inlier_in_the_window_but_no_observation(window: int) -> None:
    scene, rng = make_scene(2), np.random.default_rng(2)
    label = one_track_per_point()
    label[rng.random(label.shape) < 0.6] = -1
    triangulated = scene.triangulate(label)
    tracks = triangulated.tracks
    predicted = predict_observations(triangulated, MIDDLE, window)
    expected = {}
    for track in range(tracks.count):
        own = np.flatnonzero(tracks.track == track)
        gap = {int(o): abs(int(tracks.frame[o]) - MIDDLE) for o in own if triangulated.inlier[o]}
        if MIDDLE not in tracks.frame[own] and gap and min(gap.values()) <= window:
            expected[track] = min(gap.values())
    assert predicted.track.tolist() == list(expected) and expected
    np.testing.assert_array_equal(tracks.track[predicted.nearest], predicted.track)
    assert np.abs(tracks.frame[predicted.nearest] - MIDDLE).tolist() == list(expected.values())
    assert triangulated.inlier[predicted.nearest].all()


def test_displaced_observations_are_not_the_nearest_of_a_prediction() -> None:
    displaced = np.arange(POINTS) < 25
    triangulated = make_scene().displace(displaced).triangulate(without_frame(MIDDLE + 1))
    predicted = predict_observations(triangulated, MIDDLE + 1, 1)
    before, after = (triangulated.tracks.frame[predicted.nearest] == MIDDLE + step for step in (0, 2))
    np.testing.assert_array_equal(before | after, True)
    assert not before[displaced[predicted.track]].any() and before[~displaced[predicted.track]].mean() > 0.9


@pytest.mark.parametrize("seed", range(4))
def test_predictions_are_the_pixels_of_the_points(seed: int) -> None:
    scene = make_scene(seed, noise=0.0)
    predicted = predict_observations(scene.triangulate(without_frame(4)), 4, WINDOW)
    frame, keypoint = scene.keypoints[4], np.argsort(scene.order[4])
    np.testing.assert_allclose(predicted.range_m, frame.range_m[keypoint], atol=1e-9)
    np.testing.assert_allclose(predicted.bearing_rad, frame.bearing_rad[keypoint], atol=1e-9)
    ratio = np.median(np.sqrt(predicted.covariance[:, 0, 0])) / feature_sigma(SONAR, CONFIG.noise)[0]
    assert 0.1 < ratio < 1.2, "eight views determine a point better than one"


def test_predicted_covariance_is_that_of_sampled_points() -> None:
    triangulated = make_scene(1).triangulate(without_frame(4))
    predicted = predict_observations(triangulated, 4, WINDOW)
    rng, sonar_from_world = np.random.default_rng(0), invert(triangulated.world_from_sonar[4])
    for row in (0, 20, 40):
        track = predicted.track[row]
        cloud = rng.multivariate_normal(triangulated.xyz_m[track], triangulated.covariance_m2[track], 20000)
        sampled = np.cov(range_bearing(transform(sonar_from_world, cloud)).T)
        scale = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
        np.testing.assert_allclose(predicted.covariance[row] / scale, sampled / scale, atol=0.05)


def test_points_outside_image_or_aperture_are_not_predicted() -> None:
    scene = make_scene(noise=0.0)
    triangulated = scene.triangulate(without_frame(4))
    range_m, bearing_rad, elevation_rad = project(transform(invert(scene.world_from_sonar[4]), scene.xyz_m))
    low_m, high_m = np.quantile(range_m, [0.2, 0.8])
    left_rad, right_rad = np.quantile(bearing_rad, [0.2, 0.8])
    sonar = SonarModel.evenly_spaced("small", (low_m, high_m), (left_rad, right_rad), (600, 256), 0.12)
    predicted = predict_observations(replace(triangulated, sonar=sonar), 4, WINDOW)
    inside = (range_m >= low_m) & (range_m <= high_m) & (bearing_rad >= left_rad) & (bearing_rad <= right_rad)
    inside &= np.abs(elevation_rad) <= 0.06 + APERTURE_MARGIN_RAD
    elsewhere = replace(triangulated, sonar=replace(SONAR, elevation_aperture_rad=0.12)).inlier
    observed_elsewhere = np.isin(np.arange(POINTS), triangulated.tracks.track[elsewhere])
    assert predicted.track.tolist() == np.flatnonzero(inside & observed_elsewhere).tolist()
    assert 0 < len(predicted.track) < POINTS / 2


def test_inliers_behind_the_sonar_are_those_ahead_of_it() -> None:
    """Bearings jump from pi to -pi astern."""
    ahead = replace(make_scene(noise=2.5).triangulate(one_track_per_point()), sonar=ALL_AROUND)
    assert 0.05 < np.mean(~ahead.inlier) < 0.95
    np.testing.assert_array_equal(turn_astern(ahead).inlier, ahead.inlier)


def test_points_that_a_turned_frame_does_not_see_are_not_predicted() -> None:
    triangulated = make_scene(noise=0.0).triangulate(without_frame(MIDDLE))
    turn = make_pose(np.zeros(3), Rotation.from_rotvec([0.0, 0.0, 0.7]))
    poses = triangulated.world_from_sonar.copy()
    poses[MIDDLE] = poses[MIDDLE] @ turn
    turned = replace(triangulated, world_from_sonar=poses)
    seen = SONAR.sees(transform(invert(poses[MIDDLE]), turned.xyz_m))
    assert 0.1 < seen.mean() < 0.9
    np.testing.assert_array_equal(predict_observations(turned, MIDDLE, WINDOW).track, np.flatnonzero(seen))
