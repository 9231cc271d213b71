"""Loop check: result of the verification of a loop, and mutual consistency of two loops."""

from dataclasses import dataclass

import numpy as np

from asfm.types import FloatArray, Matches


@dataclass(frozen=True)
class LoopCheck:
    """Result of the verification of a pair of frames."""

    matches: Matches
    """Inliers of one planar motion, whether or not the pair is accepted."""
    reason: str
    """Test that rejected the pair; empty if it is accepted."""
    shift_m: FloatArray
    """(2,) mean error of the predicted pose in frame a's horizontal plane, as estimated from the matches."""
    tolerance_m: float
    """Uncertainty of that error: the median planar tolerance of the matches."""
    sure: bool = False
    """Whether the number of false alarms alone accepts the pair; others need a sure pair consistent with them."""

    @property
    def accepted(self) -> bool:
        """Whether the pair passed every test."""
        return not self.reason


def reject_loop(matches: Matches, reason: str) -> LoopCheck:
    """Return the result for a pair that fails a test."""
    return LoopCheck(matches, reason, np.zeros(2), 0.0)


def are_mutually_consistent(first: LoopCheck, second: LoopCheck, window: int) -> bool:
    """Return whether two different loops near each other agree on the pose error, at least one of them being sure.

    Args:
        first: result for one pair of frames.
        second: result for another pair.
        window: largest difference in frames between the pairs, for either of their frames.
    """
    gap_a = abs(first.matches.frame_a - second.matches.frame_a)
    gap_b = abs(first.matches.frame_b - second.matches.frame_b)
    difference_m = float(np.linalg.norm(first.shift_m - second.shift_m))
    agree = difference_m <= 2 * max(first.tolerance_m, second.tolerance_m)
    return (first.sure or second.sure) and gap_a + gap_b > 0 and max(gap_a, gap_b) <= window and agree
