"""Statistics of matches over frame pairs: planted errors come back, in metres and in pixels."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.evaluation.match_statistics import measure_pairs, pool_statistics
from asfm.types import Trajectory
from tests.evaluation.matched_run import MatchedRun
from tests.evaluation.test_matching import A_FROM_B, SONAR


def test_pairs_state_gap_and_view_change() -> None:
    run = MatchedRun()
    pairs = measure_pairs(run.keypoints, run.matches, run.sequence, run.read_truth)
    assert sorted((pair.gap, len(pair.on_arc)) for pair in pairs) == [(1, 0), (1, 16), (3, 3)]
    for pair in pairs:
        assert pair.change.distance_m == pytest.approx(np.linalg.norm(A_FROM_B[:3, 3]))
        assert pair.change.rotation_deg == pytest.approx(4, abs=0.3)
        assert pair.quality is not None


def test_planted_bias_is_measured_in_metres_and_pixels() -> None:
    run = MatchedRun(range_error_m=0.015, bearing_error_rad=-0.006)
    pooled = pool_statistics(measure_pairs(run.keypoints, run.matches, run.sequence, run.read_truth), SONAR)
    assert (pooled.matches, pooled.precision, pooled.recall) == (19, 15 / 19, 15 / 90)
    assert pooled.arc_inlier_ratio is not None and pooled.arc_inlier_ratio >= 15 / 19
    error = pooled.error
    assert error is not None
    assert error.range_bias_m == pytest.approx(0.015) and error.range_sigma_m == pytest.approx(0, abs=1e-9)
    assert error.bearing_bias_rad == pytest.approx(-0.006) and error.bearing_sigma_rad == pytest.approx(0, abs=1e-9)
    assert error.range_bias_px == pytest.approx(0.015 / (7.5 / 300))
    assert error.bearing_bias_px == pytest.approx(-0.006 / (1.2 / 128))


def test_planted_noise_is_the_standard_deviation() -> None:
    run = MatchedRun()
    range_m = run.keypoints[1].range_m + np.tile([0.03, -0.01], 15)
    run.keypoints[1] = replace(run.keypoints[1], range_m=range_m)
    pairs = measure_pairs(run.keypoints, run.matches[:1], run.sequence, run.read_truth)
    error = pool_statistics(pairs, SONAR).error
    assert error is not None
    assert error.range_bias_m == pytest.approx(0.01) and error.range_sigma_m == pytest.approx(0.02)
    assert error.range_sigma_px == pytest.approx(0.02 / (7.5 / 300))


def test_poses_alone_give_the_arc_and_nothing_true_gives_nothing() -> None:
    run = MatchedRun()
    pooled = pool_statistics(measure_pairs(run.keypoints, run.matches, run.sequence, None), SONAR)
    assert (pooled.matches, pooled.arc_inlier_ratio) == (19, 15 / 19)
    assert pooled.precision is None and pooled.recall is None and pooled.error is None
    assert measure_pairs(run.keypoints, run.matches, replace(run.sequence, groundtruth=None), run.read_truth) == []
    nothing = pool_statistics([], SONAR)
    assert (nothing.matches, nothing.arc_inlier_ratio, nothing.error) == (0, None, None)


def test_frames_without_a_true_pose_are_left_out() -> None:
    run = MatchedRun()
    assert run.sequence.groundtruth is not None
    half = Trajectory(np.arange(2.0), run.sequence.groundtruth.world_from_vehicle[:2])
    pairs = measure_pairs(run.keypoints, run.matches, replace(run.sequence, groundtruth=half), None)
    assert [(pair.gap, len(pair.on_arc)) for pair in pairs] == [(1, 16)]
