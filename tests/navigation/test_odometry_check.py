"""Hypothesis test of odometry: decision rules, and arc distances of right, faulty and noisy odometry."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.config import BackendConfig, Config
from asfm.geometry.poses import make_pose
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.odometry_check import (
    MIN_FRAME_PAIRS,
    OdometryTest,
    compare_odometry_hypotheses,
    measure_disagreement,
)
from asfm.navigation.odometry_hypotheses import AS_RECORDED, PointPairs, planar_inliers
from asfm.types import FloatArray
from tests.worlds import (
    VEHICLE_FRAMES,
    VEHICLE_LEVER_ARM,
    make_constraints,
    make_vehicle_path,
    make_vehicle_sequence,
    mirror_axis,
    observe_floor,
    pair_points,
)


@pytest.fixture(scope="module")
def pairs() -> list[PointPairs]:
    return planar_inliers(pair_points(observe_floor()), np.random.default_rng(0))


def run_test(poses: FloatArray, pairs: list[PointPairs]) -> OdometryTest | None:
    sequence = make_vehicle_sequence()
    sensors = make_constraints(sequence, poses, np.tile([0.005, 0.02], (VEHICLE_FRAMES - 1, 1)), measured=True)
    return compare_odometry_hypotheses(poses, sensors, pairs, sequence, Config())


def make_result(recorded: float, x: float, y: float, stationary: float, planar: float, over: float) -> OdometryTest:
    return OdometryTest(20, {AS_RECORDED: recorded, "x": x, "y": y}, stationary, planar, over)


@pytest.mark.parametrize(
    ("result", "fault", "contradicted"),
    [
        (make_result(1.0, 0.90, 0.90, 1.0, 0.1, 2.0), None, True),
        (make_result(1.0, 0.90, 0.90, 1.0, 0.1, 1.4), None, False),
        (make_result(1.0, 0.90, 0.30, 1.0, 0.1, 1.4), "y", True),
        (make_result(1.0, 0.34, 0.30, 1.0, 0.1, 1.4), "x", True),
        (make_result(1.0, 0.35, 0.30, 1.0, 0.1, 1.4), "y", True),
        (make_result(1.0, 0.90, 0.30, 1.0, 0.1, 0.7), "y", False),
        (make_result(1.0, 0.90, 0.90, 0.7, 0.1, 1.4), None, True),
        (make_result(1.0, 0.90, 0.90, 0.9, 0.1, 1.4), None, False),
        (make_result(1.0, 0.90, 0.30, 0.2, 0.7, 9.0), None, False),
        (make_result(1.0, 0.90, 0.50, 0.7, 0.1, 1.4), None, True),
        (make_result(1.0, 0.90, 0.40, 0.56, 0.1, 1.4), "y", True),
        (make_result(1.0, 0.90, 0.50, 1.0, 0.1, 3.0), None, True),
        (make_result(1.0, 0.90, 0.50, 1.0, 0.3, 3.0), "y", True),
    ],
    ids=[
        "far beyond the noise",
        "within the noise",
        "a fault explains it",
        "of equal faults the commonest",
        "of unequal faults the best",
        "a fault explains what noise explains too",
        "worse than no motion",
        "about as good as no motion",
        "the images show no motion that fits better",
        "a fault hardly better than no motion",
        "a fault as near as right odometry is",
        "a fault far from the motion that the images show",
        "a fault near the motion that the images show",
    ],
)
def test_decision_rules(result: OdometryTest, fault: str | None, contradicted: bool) -> None:
    assert result.likely_fault == fault and result.contradicted == contradicted


def test_right_odometry_is_within_the_noise(pairs: list[PointPairs]) -> None:
    result = run_test(make_vehicle_path(), pairs)
    assert result is not None and not result.contradicted and result.likely_fault is None
    assert result.pairs == len(pairs) and result.over_expected < 0.75
    assert result.distance_m[AS_RECORDED] < result.stationary_m and result.planar_m < result.stationary_m


def test_fault_is_recognised_and_its_correction_fits_as_well_as_the_truth(pairs: list[PointPairs]) -> None:
    truth, result = run_test(make_vehicle_path(), pairs), run_test(mirror_axis(1)(make_vehicle_path()), pairs)
    assert truth is not None and result is not None and result.contradicted
    assert result.likely_fault == "with its y axis mirrored"
    assert result.distance_m[result.likely_fault] == pytest.approx(truth.distance_m[AS_RECORDED], rel=1e-6)
    assert result.pairs == len(pairs) and result.suspicious and result.image_axis is None


def test_result_does_not_depend_on_the_world_frame(pairs: list[PointPairs]) -> None:
    other = make_pose(np.array([5.0, 1.0, -2.0]), Rotation.from_euler("z", 1.0))
    here, there = run_test(make_vehicle_path(), pairs), run_test(other @ make_vehicle_path(), pairs)
    assert here is not None and there is not None
    assert there.distance_m[AS_RECORDED] == pytest.approx(here.distance_m[AS_RECORDED], abs=1e-9)
    assert there.over_expected == pytest.approx(here.over_expected, abs=1e-9)


def test_too_few_frame_pairs_are_not_tested(pairs: list[PointPairs]) -> None:
    assert run_test(mirror_axis(1)(make_vehicle_path()), pairs[: MIN_FRAME_PAIRS - 1]) is None
    assert run_test(mirror_axis(1)(make_vehicle_path()), pairs[:MIN_FRAME_PAIRS]) is not None


def test_disagreement_is_the_planted_error_per_step() -> None:
    """Planar motions that differ from the odometry by the same step, at every gap."""
    path = make_vehicle_path() @ VEHICLE_LEVER_ARM
    error = make_pose(np.array([0.3, 0.4, 0.0]), Rotation.from_euler("z", 0.1))
    nothing = np.zeros((0, 2))
    pairs = [
        PointPairs(frame, frame + 1, nothing, nothing, np.linalg.inv(path[frame]) @ path[frame + 1] @ error)
        for frame in range(20)
    ]
    found = measure_disagreement(make_vehicle_path(), pairs, VEHICLE_LEVER_ARM)
    np.testing.assert_allclose(found / 1.4826, [0.1, 0.5], rtol=0.1)
    still = np.tile(np.eye(4), (VEHICLE_FRAMES, 1, 1))
    wider = [replace(pair, frame_b=pair.frame_a + 2) for pair in pairs]
    one, two = (measure_disagreement(still, some, np.eye(4)) for some in (pairs, wider))
    np.testing.assert_allclose(two, one / 2)


def test_odometry_read_from_a_sequence_passes(pairs: list[PointPairs]) -> None:
    odometry = read_navigation(make_vehicle_sequence(3), BackendConfig()).odometry
    assert odometry is not None
    result = run_test(odometry.world_from_vehicle, pairs)
    assert result is not None and not result.contradicted


def test_odometry_beyond_the_noise_is_not_suspected_where_the_images_show_no_better_motion(
    pairs: list[PointPairs],
) -> None:
    """The noise that is stated is a hundredth of the true one, and no planar motion beats the odometry."""
    sequence, path = make_vehicle_sequence(), make_vehicle_path()
    sensors = make_constraints(sequence, path, np.full((VEHICLE_FRAMES - 1, 2), 1e-5), measured=True)
    config = Config.model_validate({"noise": {"range_bins": 0.01, "bearing_beams": 0.01, "min_bearing_deg": 0.003}})
    sonar_path = path @ VEHICLE_LEVER_ARM
    alike = [
        replace(pair, a_from_b=np.linalg.inv(sonar_path[pair.frame_a]) @ sonar_path[pair.frame_b]) for pair in pairs
    ]
    for poses, given, suspicious in ((path, alike, False), (mirror_axis(1)(path), pairs, True)):
        found = compare_odometry_hypotheses(poses, sensors, given, sequence, config)
        assert found is not None and found.over_expected > 5 and found.suspicious == suspicious
