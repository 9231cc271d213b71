"""Matcher quality of a run in memory."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.evaluation.matcher_quality import measure_matcher, usable_truth
from asfm.types import Tracks, Trajectory
from tests.evaluation.matched_run import MatchedRun


def tracks_of(run: MatchedRun) -> Tracks:
    """Two tracks of frames 0 and 2, and a long one of one point; the second one changes over to another point."""
    first, last = run.keypoints[0], run.keypoints[1]
    index = [(0, 0, 0), (0, 2, 0), (1, 0, 1), (1, 2, 2), (2, 0, 3), (2, 1, 3), (2, 2, 3), (2, 3, 3)]
    track, frame, keypoint = np.array(index, dtype=np.int64).T
    sets = [first, last, first, last]
    range_m = np.array([sets[f].range_m[k] for _, f, k in index])
    bearing_rad = np.array([sets[f].bearing_rad[k] for _, f, k in index])
    return Tracks(track, frame, range_m, bearing_rad, keypoint=keypoint)


def test_every_measure_of_a_simulated_run() -> None:
    run = MatchedRun(range_error_m=0.01)
    found = measure_matcher(run.keypoints, run.matches, tracks_of(run), run.sequence, run.read_truth)
    assert (found.matches, found.precision, found.recall) == (19, 15 / 19, 15 / 90)
    assert found.error is not None and found.error.range_bias_m == pytest.approx(0.01)
    assert found.tracks == 3 and found.track_length == pytest.approx(8 / 3) and found.track_length_median == 2
    assert found.track_purity == pytest.approx((1 + 0.5 + 1) / 3)
    assert found.keypoint_coverage is not None and found.match_coverage is not None
    assert 0 < found.match_coverage < found.keypoint_coverage < 1
    assert found.left_out == ()
    flat = found.as_dict()
    assert flat["range_bias_m"] == pytest.approx(0.01) and flat["precision"] == 15 / 19
    assert all(value is not None for value in flat.values())


def test_without_elevations_the_arc_remains_and_without_poses_lengths_and_coverage() -> None:
    run = MatchedRun()
    found = measure_matcher(run.keypoints, run.matches, tracks_of(run), run.sequence)
    assert (found.precision, found.recall, found.track_purity, found.error) == (None, None, None, None)
    assert found.arc_inlier_ratio == 15 / 19
    assert found.left_out == ("precision", "recall", "localisation error", "track purity")
    blind = replace(run.sequence, groundtruth=None)
    found = measure_matcher(run.keypoints, run.matches, tracks_of(run), blind, run.read_truth)
    assert found.arc_inlier_ratio is None and found.track_purity is None and "arc inlier ratio" in found.left_out
    assert found.matches == 19 and found.track_length == pytest.approx(8 / 3) and found.match_coverage is not None


def test_elevations_are_not_used_where_a_frame_has_no_true_pose() -> None:
    run = MatchedRun()
    assert usable_truth(run.sequence, run.read_truth) is not None
    assert run.sequence.groundtruth is not None
    half = Trajectory(np.arange(2.0), run.sequence.groundtruth.world_from_vehicle[:2])
    assert usable_truth(replace(run.sequence, groundtruth=half), run.read_truth) is None
