"""Number of false alarms against exact rational arithmetic, and its monotony."""

from fractions import Fraction
from math import comb, log10

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asfm.frontend.loops.false_alarms import log_false_alarms
from asfm.types import BoolArray


def make_candidates(matched: int, per_row: int, count: int = 100) -> BoolArray:
    """Make (count, count) candidates: some rows with the same number each, the others without any."""
    candidates = np.zeros((count, count), dtype=bool)
    candidates[:matched, :per_row] = True
    return candidates


def exact_log_false_alarms(tried: int, agree: int, probability: Fraction) -> float:
    """Sum the binomial tail: at least agree - 2 of the tried - 2 other matches are inliers by chance."""
    others = tried - 2
    tail = sum(
        comb(others, inliers) * probability**inliers * (1 - probability) ** (others - inliers)
        for inliers in range(agree - 2, others + 1)
    )
    expected = comb(tried, 2) * tail
    return log10(expected.numerator) - log10(expected.denominator)


@settings(max_examples=60, deadline=None)
@given(st.integers(3, 80), st.data(), st.integers(1, 60))
def test_value_equals_exact_arithmetic(tried: int, data: st.DataObject, per_row: int) -> None:
    agree = data.draw(st.integers(3, tried))
    found = log_false_alarms(tried, agree, make_candidates(agree, per_row))
    assert found == pytest.approx(exact_log_false_alarms(tried, agree, Fraction(per_row, 100)), abs=1e-6)


def test_few_inliers_are_explained_by_chance_and_many_are_not() -> None:
    candidates = make_candidates(12, 2)
    assert log_false_alarms(40, 4, candidates) > -2
    assert log_false_alarms(40, 14, candidates) < -6


def test_value_falls_with_inliers_and_rises_with_matches_tried_and_with_candidates() -> None:
    candidates = make_candidates(12, 2)
    assert (np.diff([log_false_alarms(40, agree, candidates) for agree in range(3, 40)]) < 0).all()
    assert (np.diff([log_false_alarms(tried, 12, candidates) for tried in range(12, 400, 20)]) > 0).all()
    assert (np.diff([log_false_alarms(40, 12, make_candidates(12, count)) for count in range(1, 30)]) > 0).all()


def test_without_inliers_beyond_two_or_without_candidates_the_value_is_zero() -> None:
    assert log_false_alarms(40, 2, make_candidates(2, 1)) == 0.0
    assert log_false_alarms(0, 0, make_candidates(0, 0, 0)) == 0.0
    assert log_false_alarms(40, 12, make_candidates(0, 0)) == 0.0
