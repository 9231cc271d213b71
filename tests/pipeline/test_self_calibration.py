"""Self-calibration stage: nothing unless requested, and corrections of lever arm and ranges."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.backend.graph.self_calibration import Calibration
from asfm.config import Config
from asfm.geometry.poses import make_pose
from asfm.pipeline.self_calibration import MIN_RANGE_M, apply_calibration, estimate_calibration
from asfm.stages import StageClock
from asfm.types import Keypoints
from tests.backend.loops.round_trip import make_round_trip
from tests.worlds import make_vehicle_sequence

DESCRIPTORS, PATCHES = np.zeros((3, 61), np.uint8), np.zeros((0, 29, 29), np.float32)
RANGE_M = np.array([0.01, 2.0, 5.0])
KEYPOINTS = Keypoints(np.zeros((3, 2)), RANGE_M, np.zeros(3), np.ones(3), DESCRIPTORS, PATCHES)


def test_without_a_request_nothing_is_estimated_or_timed() -> None:
    clock = StageClock()
    found = estimate_calibration(make_round_trip(0).solution, Config(), clock)
    assert not found.sigma.any() and not found.rotation_rad.any() and found.range_bias_m == 0.0
    assert not clock.reports


def test_ranges_are_corrected_by_the_bias_and_stay_positive() -> None:
    sequence = make_vehicle_sequence()
    calibration = Calibration(np.zeros(3), 0.05, np.ones(4))
    corrected, (keypoints,) = apply_calibration(calibration, sequence, [KEYPOINTS])
    np.testing.assert_allclose(keypoints.range_m, [MIN_RANGE_M, 1.95, 4.95])
    np.testing.assert_array_equal(corrected.vehicle_from_sonar, sequence.vehicle_from_sonar)
    np.testing.assert_array_equal(KEYPOINTS.range_m, RANGE_M)


def test_lever_arm_is_rotated_and_keeps_its_translation() -> None:
    lever_arm = make_pose(np.array([0.4, 0.1, -0.2]), Rotation.from_euler("y", 0.3))
    sequence = replace(make_vehicle_sequence(), vehicle_from_sonar=lever_arm)
    turn_rad = np.array([0.01, -0.02, 0.03])
    corrected, (keypoints,) = apply_calibration(Calibration(turn_rad, 0.0, np.ones(4)), sequence, [KEYPOINTS])
    found = corrected.vehicle_from_sonar
    np.testing.assert_array_equal(found[:3, 3], lever_arm[:3, 3])
    size_rad = Rotation.from_matrix(lever_arm[:3, :3].T @ found[:3, :3]).magnitude()
    np.testing.assert_allclose(size_rad, np.linalg.norm(turn_rad))
    np.testing.assert_array_equal(keypoints.range_m, RANGE_M)


def test_without_observations_nothing_is_estimated() -> None:
    solution, clock = make_round_trip(0).solution, StageClock()
    blind = replace(solution, observed=np.zeros_like(solution.observed))
    config = Config.model_validate({"backend": {"estimate_lever_rotation": True, "estimate_range_bias": True}})
    assert not estimate_calibration(blind, config, clock).sigma.any() and not clock.reports
