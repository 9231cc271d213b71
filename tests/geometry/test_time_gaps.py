"""Gaps between stamps, against a plain loop."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asfm.geometry.time_gaps import longest_bridge_s, measure_gaps, median_interval_s, nearest_stamps

stamps = st.lists(st.integers(0, 60), min_size=1, max_size=12, unique=True).map(lambda values: np.sort(values) / 4.0)


@given(stamps, stamps)
def test_gaps_agree_with_a_plain_search(reading_s: np.ndarray, at_s: np.ndarray) -> None:
    nearest_s, gap_s = measure_gaps(reading_s, at_s)
    for time_s, near_s, found_s in zip(at_s, nearest_s, gap_s, strict=True):
        assert near_s == np.abs(reading_s - time_s).min()
        before, after = reading_s[reading_s <= time_s], reading_s[reading_s >= time_s]
        if not len(before) or not len(after):
            assert np.isinf(found_s)
        elif before[-1] != after[0]:
            assert found_s == after[0] - before[-1]
        else:
            assert found_s in (0.0, *np.diff(reading_s))
    np.testing.assert_array_equal(np.abs(nearest_stamps(reading_s, at_s) - at_s), nearest_s)


@pytest.mark.parametrize(("interval_s", "expected_s"), [(0.01, 1.0), (0.3, 1.0), (0.5, 1.5), (10.0, 30.0)])
def test_a_second_or_three_intervals_are_bridged(interval_s: float, expected_s: float) -> None:
    assert longest_bridge_s(interval_s) == pytest.approx(expected_s)
    assert median_interval_s(np.arange(5.0) * interval_s) == pytest.approx(interval_s)
    assert median_interval_s(np.zeros(1), 7.0) == 7.0


def test_of_two_stamps_as_near_the_earlier_one_is_taken() -> None:
    np.testing.assert_array_equal(nearest_stamps(np.array([0.0, 1.0, 2.0]), np.array([0.5, 1.5, 1.75])), [0, 1, 2])
