"""Mutual consistency of two loops: distance in frames, agreement of the pose error, one of them sure."""

from itertools import product

import numpy as np
import pytest

from asfm.frontend.loops.loop_check import LoopCheck, are_mutually_consistent, reject_loop
from asfm.types import Matches


def make_check(
    frames: tuple[int, int] = (10, 50),
    shift_m: tuple[float, float] = (0.2, -0.1),
    tolerance_m: float = 0.05,
    sure: bool = True,
) -> LoopCheck:
    matches = Matches(*frames, np.zeros((1, 2), dtype=np.int64), np.zeros(1))
    return LoopCheck(matches, "", np.array(shift_m), tolerance_m, sure)


def consistent(first: LoopCheck, second: LoopCheck, window: int = 8) -> bool:
    """Return the result, which must not depend on the order."""
    result = are_mutually_consistent(first, second, window)
    assert are_mutually_consistent(second, first, window) == result
    return result


def test_a_pair_is_not_consistent_with_itself() -> None:
    assert not consistent(make_check(), make_check())
    assert consistent(make_check(), make_check((10, 51)))
    assert consistent(make_check(), make_check((9, 50)))


@pytest.mark.parametrize("window", [1, 3])
def test_both_frames_must_be_in_the_window(window: int) -> None:
    for gap_a, gap_b in product(range(-5, 6), repeat=2):
        expected = (gap_a, gap_b) != (0, 0) and abs(gap_a) <= window and abs(gap_b) <= window
        assert consistent(make_check(), make_check((10 + gap_a, 50 + gap_b)), window) == expected


def test_pose_errors_must_agree_within_twice_the_larger_tolerance() -> None:
    for difference_m, expected in ((0.19, True), (0.21, False)):
        for direction in ((1.0, 0.0), (0.0, -1.0), (-0.6, 0.8)):
            shift_m = (0.2 + difference_m * direction[0], -0.1 + difference_m * direction[1])
            other = make_check((11, 51), shift_m, tolerance_m=0.1)
            assert consistent(make_check(), other) == expected


def test_one_of_the_two_must_be_sure() -> None:
    for first, second in product((True, False), repeat=2):
        assert consistent(make_check(sure=first), make_check((11, 51), sure=second)) == (first or second)


def test_a_rejected_loop_keeps_its_matches_and_the_reason() -> None:
    matches = make_check().matches
    check = reject_loop(matches, "coverage")
    assert check.matches is matches and check.reason == "coverage"
    assert not check.accepted and not check.sure and make_check().accepted
