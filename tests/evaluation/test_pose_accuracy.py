"""Pose accuracy: shares within thresholds and the area under their curve, against numerical integration."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asfm.evaluation.pose_accuracy import area_under_curve, list_accuracy, share_within


def test_shares_count_up_to_the_threshold() -> None:
    error = np.array([0.0, 1.0, 1.1, 4.0])
    assert [share_within(error, at) for at in (0.5, 1.0, 2.0, 10.0)] == [0.25, 0.5, 0.75, 1.0]


@given(st.lists(st.floats(0, 20), min_size=1, max_size=30), st.sampled_from([1, 2, 5, 10]))
def test_area_is_that_under_the_curve_of_shares(errors: list[float], threshold: int) -> None:
    error = np.array(errors)
    middle = (np.arange(20_000) + 0.5) * threshold / 20_000
    expected = np.mean(np.searchsorted(np.sort(error), middle, side="right")) / len(error)
    assert area_under_curve(error, threshold) == pytest.approx(expected, abs=1e-4)


@given(st.lists(st.floats(0, 20), min_size=1, max_size=30), st.sampled_from([1, 2, 5, 10]))
def test_area_differs_little_from_that_of_the_joined_steps(errors: list[float], threshold: int) -> None:
    """Straight lines between the sorted errors, from (0, 0) on and level after the last one within the threshold."""
    error = np.sort(errors)
    inside = error[error < threshold]
    at = np.concatenate([[0.0], inside, [threshold]])
    share = np.concatenate([[0.0], np.arange(1, len(inside) + 1), [len(inside)]]) / len(error)
    joined = np.trapezoid(share, at) / threshold
    assert -1e-9 <= joined - area_under_curve(error, threshold) <= 1 / len(error) + 1e-9


def test_a_pose_counts_where_position_and_rotation_are_within() -> None:
    rows = list_accuracy(np.array([0.05, 0.05, 0.5, 0.0]), np.radians([0.5, 4.0, 0.5, 0.0]), path_m=10.0)
    value = {row.key: row.value for row in rows}
    assert value["poses_within_1_percent_1_deg"] == 0.5
    assert value["poses_within_5_percent_5_deg"] == 1.0
    assert value["poses_position_within_1_percent"] == value["poses_rotation_within_1_deg"] == 0.75
    assert value["pose_auc_10_percent_10_deg"] == pytest.approx(1 - (0.5 + 4 + 5 + 0) / 4 / 10)
    assert {row.key for row in rows if not row.detail} == {
        f"{kind}_{at}_percent_{at}_deg" for kind in ("poses_within", "pose_auc") for at in (1, 2, 5, 10)
    }


def test_without_a_path_the_rotations_alone_count() -> None:
    rows = list_accuracy(np.zeros(3), np.radians([0.0, 3.0, 30.0]), path_m=0.0)
    assert [row.key for row in rows] == [f"poses_rotation_within_{at}_deg" for at in (1, 2, 5, 10)]
    assert [row.value for row in rows] == pytest.approx([1 / 3, 1 / 3, 2 / 3, 2 / 3])
