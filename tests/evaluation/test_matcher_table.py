"""Matcher quality as rows: keys, groups, what is printed, and notes on what is left out."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.evaluation.matcher_table import evaluate_matcher
from asfm.types import Trajectory
from tests.evaluation.matched_run import MatchedRun
from tests.evaluation.test_matcher_quality import tracks_of
from tests.evaluation.test_matching import matches_of, same


def test_rows_of_a_simulation() -> None:
    run = MatchedRun(range_error_m=0.01, bearing_error_rad=0.005)
    rows, notes = evaluate_matcher(run.keypoints, run.matches, tracks_of(run), run.sequence, run.read_truth)
    value = {row.key: row.value for row in rows}
    assert notes == () and len(value) == len({row.name for row in rows}) == len(rows)
    assert value["match_count_gap_1"] == 16 and value["match_precision_gap_1"] == 12 / 16
    assert value["match_recall_gap_1"] == 12 / 60 and value["match_precision_gap_3"] == 1.0
    assert value["match_count_overall"] == 19 and value["match_precision_overall"] == 15 / 19
    assert value["match_count_distance_20_to_50_cm"] == 19
    assert value["match_recall_rotation_2_to_5_deg"] == 15 / 90
    assert value["match_range_bias_m_gap_1"] == pytest.approx(0.01)
    assert value["match_bearing_bias_deg_overall"] == pytest.approx(0.2865, abs=1e-3)
    assert value["match_bearing_bias_px_overall"] == pytest.approx(0.005 / (1.2 / 128))
    assert value["track_purity"] == pytest.approx(2.5 / 3)


def test_few_rows_are_printed() -> None:
    run = MatchedRun()
    rows, _ = evaluate_matcher(run.keypoints, run.matches, tracks_of(run), run.sequence, run.read_truth)
    printed = {row.key for row in rows if not row.detail}
    measures = ("count", "precision", "recall", "arc_inlier_ratio")
    expected = {f"match_{measure}_{group}" for measure in measures for group in ("gap_1", "overall")}
    expected |= {"track_count", "track_length_mean", "track_length_median", "track_purity"}
    assert printed == expected | {"keypoint_coverage", "match_coverage"}


def test_loop_closures_are_pooled() -> None:
    run = MatchedRun()
    sequence, keypoints = run.sequence, run.keypoints * 4
    assert sequence.groundtruth is not None
    truth = sequence.groundtruth
    stamps_s = np.arange(16.0)
    many = Trajectory(stamps_s, truth.world_from_vehicle[[0, 1, 2, 3] * 4])
    long = replace(sequence, timestamps_s=stamps_s, groundtruth=many)
    matches = [matches_of(same(5), 0, 9), matches_of(same(4), 2, 15), matches_of(same(3), 0, 8)]
    rows, _ = evaluate_matcher(keypoints, matches, tracks_of(run), long, None)
    value = {row.key: row.value for row in rows}
    assert value["match_count_gap_9_and_more"] == 9 and value["match_count_gap_8"] == 3


def test_rows_of_a_recording_are_arc_inlier_ratios_and_a_note() -> None:
    run = MatchedRun()
    rows, notes = evaluate_matcher(run.keypoints, run.matches, tracks_of(run), run.sequence, None)
    value = {row.key: row.value for row in rows}
    assert value["match_arc_inlier_ratio_gap_1"] == 12 / 16 and value["match_arc_inlier_ratio_overall"] == 15 / 19
    assert not [key for key in value if "precision" in key or "recall" in key or "bias" in key or "purity" in key]
    assert len(notes) == 1 and "without precision, recall, localisation error, track purity" in notes[0]
    blind = replace(run.sequence, groundtruth=None)
    rows, notes = evaluate_matcher(run.keypoints, run.matches, tracks_of(run), blind, None)
    keys = {row.key for row in rows}
    assert "match_count_overall" in keys and "match_coverage" in keys and not any("ratio" in key for key in keys)
    assert "arc inlier ratio" in notes[0] and "true poses" in notes[0]


def test_a_group_without_matches_has_a_count_alone() -> None:
    run = MatchedRun()
    rows, _ = evaluate_matcher(run.keypoints, [matches_of([], 0, 2)], tracks_of(run), run.sequence, None)
    assert [row.value for row in rows if row.key == "match_count_gap_2"] == [0]
    assert not [row for row in rows if row.key.startswith("match_arc")]
