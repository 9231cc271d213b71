"""Frame pairs: selection of matches, and predicted elevation arcs with their uncertainty, against sampled poses."""

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.config import NoiseConfig
from asfm.frontend.matching.frame_pair import predict_arcs
from asfm.geometry.feature_noise import difference_sigma
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import back_project
from asfm.navigation.pose_prediction import PosePrediction
from tests.worlds import B_FROM_A, MATCHING_SONAR, make_frame_pair, make_keypoints, range_bearing

NOISE = NoiseConfig()


def test_take_selects_matches_with_their_ratios_and_keeps_the_keypoints() -> None:
    pair = make_frame_pair()
    which = np.arange(len(pair)) % 3 == 1
    taken = pair.take(which)
    assert len(taken) == which.sum() == 20
    assert taken.index.tolist() == [[number, number] for number in range(1, 60, 3)]
    np.testing.assert_array_equal(taken.nearest.ratio, pair.nearest.ratio[which])
    np.testing.assert_array_equal(taken.nearest.mutual, pair.nearest.mutual[which])
    assert taken.keypoints_a is pair.keypoints_a and taken.keypoints_b is pair.keypoints_b and taken.arcs is pair.arcs


def test_pixels_are_those_of_the_matched_keypoints() -> None:
    pair = make_frame_pair()
    pair.nearest.index[:, 1] = pair.nearest.index[::-1, 1]
    pixel_a, pixel_b = pair.pixels()
    for (a, b), in_a, in_b in zip(pair.index.tolist(), pixel_a, pixel_b, strict=True):
        assert in_a.tolist() == [pair.keypoints_a.range_m[a], pair.keypoints_a.bearing_rad[a]]
        assert in_b.tolist() == [pair.keypoints_b.range_m[b], pair.keypoints_b.bearing_rad[b]]


def test_predicted_arcs_run_through_the_points_at_every_elevation() -> None:
    """Frame 2 is where B_FROM_A puts it, in a world frame that is neither of the two sonars'."""
    world_from_a = make_pose(np.array([3.0, -4.0, 2.0]), Rotation.from_rotvec([0.3, 0.2, -1.0]))
    poses = np.stack([world_from_a, np.eye(4), world_from_a @ invert(B_FROM_A)])
    rng = np.random.default_rng(0)
    keypoints = make_keypoints(rng.uniform(2, 8, 20), rng.uniform(-0.6, 0.6, 20))
    arcs, _ = predict_arcs((0, 2), keypoints, MATCHING_SONAR, PosePrediction(poses, 0.0, 0.0), NOISE)
    elevation_rad = np.linspace(-0.15, 0.15, arcs.shape[1])  # the sonar's aperture is 0.3 rad
    points = back_project(keypoints.range_m[:, None], keypoints.bearing_rad[:, None], elevation_rad)
    np.testing.assert_allclose(arcs, range_bearing(transform(B_FROM_A, points)), atol=1e-9)


def test_predicted_sigma_is_that_of_sampled_step_errors_and_feature_noise() -> None:
    """Two steps with independent errors, a point at elevation zero, noise of both keypoints."""
    rng, count = np.random.default_rng(1), 20000
    step_rotation_rad, step_translation_m = 0.01, 0.03
    moved = np.tile(back_project(np.array(4.0), np.array(0.3), 0.0), (count, 1))
    for _ in range(2):
        turn = Rotation.from_rotvec(rng.normal(0, step_rotation_rad, (count, 3)))
        moved = transform(make_pose(rng.normal(0, step_translation_m, (count, 3)), turn), moved)
    sampled = range_bearing(moved) + rng.normal(0, difference_sigma(MATCHING_SONAR, NOISE), (count, 2))
    prediction = PosePrediction(np.stack([np.eye(4)] * 3), step_rotation_rad, step_translation_m)
    keypoints = make_keypoints(np.array([4.0]), np.array([0.3]))
    _, sigma = predict_arcs((0, 2), keypoints, MATCHING_SONAR, prediction, NOISE)
    assert sigma.shape == (1, 2)
    np.testing.assert_allclose(sampled.std(axis=0), sigma[0], rtol=0.05)
