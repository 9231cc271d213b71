"""Comparison of runs: the measures picked from their evaluations, mirror images, and notes."""

from dataclasses import replace

import pytest

from asfm.evaluation.evaluation_table import EvaluationRow, EvaluationTable
from asfm.evaluation.run_comparison import ComparedRun, RunLabels, compare_run, note_differences

LABELS = RunLabels("a run", "a sequence", "akaze, mutual")
ROWS = {
    "ate_rmse_m_se3": EvaluationRow("ate_rmse_m_se3", "ATE", 0.3, "m", 0.6, 0.5),
    **{
        key: EvaluationRow(key, key, value, "")
        for key, value in {
            "match_precision_overall": 0.9,
            "match_recall_overall": 0.4,
            "match_arc_inlier_ratio_overall": 0.8,
            "match_count_overall": 120.0,
            "bound_ate_rmse_m_se3": 0.1,
            "nees_position": 1.1,
            "nees_attitude": 1.2,
        }.items()
    },
}
MIRRORED = EvaluationRow("ate_rmse_m_se3_mirror_image", "ATE of the mirror image", 0.2, "m")


def compare(*rows: EvaluationRow) -> ComparedRun:
    return compare_run(LABELS, 12.5, EvaluationTable(rows))


def test_every_measure_is_that_of_its_row() -> None:
    found = compare(*ROWS.values())
    assert (found.precision, found.recall, found.arc_inlier_ratio, found.matches) == (0.9, 0.4, 0.8, 120)
    assert (found.ate_m, found.mirror_ambiguous, found.ate_over_odometry) == (0.3, False, 0.5)
    assert found.ate_over_bound == pytest.approx(3.0)
    assert (found.nees_position, found.nees_attitude, found.seconds) == (1.1, 1.2, 12.5)
    assert note_differences((found,)) == ()


def test_the_nearer_of_run_and_mirror_image_counts_in_every_ratio_and_a_note_says_so() -> None:
    found = compare(*ROWS.values(), MIRRORED)
    assert (found.ate_m, found.mirror_ambiguous) == (0.2, True)
    assert found.ate_over_odometry == pytest.approx(0.2 / 0.6) and found.ate_over_bound == pytest.approx(2.0)
    assert "mirror image" in note_differences((found,))[0]
    farther = compare(*ROWS.values(), replace(MIRRORED, value=0.9))
    assert (farther.ate_m, farther.mirror_ambiguous) == (0.3, True)


def test_what_is_unknown_is_none() -> None:
    for found in (compare_run(LABELS, None, None), compare()):
        assert all(value in (None, False, LABELS, 12.5) for value in vars(found).values())
    without_ratio = replace(ROWS["ate_rmse_m_se3"], ratio=None)
    assert compare(without_ratio).ate_over_odometry is None, "the odometry covers other frames"
    assert compare(ROWS["ate_rmse_m_se3"]).ate_over_bound is None
    still = replace(ROWS["bound_ate_rmse_m_se3"], value=0.0)
    assert compare(ROWS["ate_rmse_m_se3"], still).ate_over_bound is None


def test_different_sequences_are_said() -> None:
    first = compare(*ROWS.values())
    other = replace(first, labels=replace(LABELS, sequence="another"))
    (note,) = note_differences((first, other, first))
    assert "2 different sequences (a sequence, another)" in note
