"""Pose prediction: relative poses through the lever arm, and sigmas checked by Monte Carlo simulation of the steps."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.config import BackendConfig
from asfm.geometry.poses import chain_steps, invert, make_pose, transform
from asfm.geometry.sonar import back_project, project
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.pose_prediction import PosePrediction, predict_poses
from asfm.types import FloatArray
from tests.worlds import VEHICLE_LEVER_ARM, VEHICLE_NOISE, make_vehicle_path, make_vehicle_sequence

SIGMA = np.array([0.01, 0.004])


def predict(poses: FloatArray, rotation_rad: float = 0.005, translation_m: float = 0.02) -> PosePrediction:
    return PosePrediction(poses, rotation_rad, translation_m)


def test_relative_poses_are_mutual_inverses_and_compose() -> None:
    prediction = predict(make_vehicle_path())
    b_from_a, c_from_b = prediction.relative_pose(3, 9), prediction.relative_pose(9, 20)
    np.testing.assert_allclose(prediction.relative_pose(9, 3), invert(b_from_a), atol=1e-12)
    np.testing.assert_allclose(c_from_b @ b_from_a, prediction.relative_pose(3, 20), atol=1e-12)
    np.testing.assert_allclose(
        transform(prediction.world_from_sonar[9] @ b_from_a, np.ones(3)),
        transform(prediction.world_from_sonar[3], np.ones(3)),
        atol=1e-12,
    )


def test_sigma_within_a_frame_is_that_of_the_points() -> None:
    found = predict(make_vehicle_path()).predicted_sigma(4, 4, np.array([1.0, 7.0]), SIGMA)
    np.testing.assert_allclose(found, [SIGMA, SIGMA])


def test_sigma_grows_with_the_root_of_the_gap_in_both_directions_and_is_bounded() -> None:
    prediction, range_m = predict(make_vehicle_path()), np.array([2.0, 8.0])
    exact = np.zeros(2)
    one, four = (prediction.predicted_sigma(0, gap, range_m, exact) for gap in (1, 4))
    np.testing.assert_allclose(four, 2 * one)
    np.testing.assert_array_equal(prediction.predicted_sigma(4, 0, range_m, exact), four)
    near = prediction.predicted_sigma(0, 1, np.zeros(1), exact)
    assert near[0, 1] == np.pi


@pytest.mark.parametrize("gap", [1, 9])
def test_sigma_covers_simulated_steps(gap: int) -> None:
    """Points ahead at elevation zero, seen after noisy steps: translations along and across the beam, turns about z."""
    rng = np.random.default_rng(0)
    point = back_project(np.array([5.0]), np.zeros(1), np.zeros(1))
    seen = []
    for _ in range(2000):
        steps = make_pose(rng.normal(0, 0.02, (gap, 3)), Rotation.from_rotvec(rng.normal(0, 0.005, (gap, 3))))
        seen.append(np.stack(project(transform(invert(chain_steps(np.eye(4), steps)[-1]), point)))[:2, 0])
    simulated = np.hypot(np.std(seen, axis=0), SIGMA)
    (found,) = predict(np.tile(np.eye(4), (10, 1, 1))).predicted_sigma(0, gap, np.array([5.0]), SIGMA)
    np.testing.assert_allclose(found, simulated, rtol=0.15)


def test_prediction_follows_the_odometry_of_the_sonar() -> None:
    sequence = make_vehicle_sequence()
    navigation = read_navigation(sequence, BackendConfig())
    prediction = predict_poses(navigation, sequence)
    assert prediction is not None and navigation.odometry is not None
    np.testing.assert_array_equal(
        prediction.world_from_sonar, navigation.odometry.world_from_vehicle @ sequence.vehicle_from_sonar
    )
    assert prediction.step_rotation_rad == VEHICLE_NOISE.odometry_rotation_rad
    lever_m = float(np.linalg.norm(VEHICLE_LEVER_ARM[:3, 3]))
    expected = np.hypot(VEHICLE_NOISE.odometry_translation_m, lever_m * VEHICLE_NOISE.odometry_rotation_rad)
    assert prediction.step_translation_m == pytest.approx(expected)


def test_without_odometry_there_is_no_prediction() -> None:
    sequence = make_vehicle_sequence()
    assert predict_poses(read_navigation(sequence, BackendConfig(use_odometry=False)), sequence) is None
