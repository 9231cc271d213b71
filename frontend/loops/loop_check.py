"""Loop check: the outcome of a loop's verification, and the mutual consistency of two loops."""

from dataclasses import dataclass

import numpy as np

from asfm.types import FloatArray, Matches


@dataclass(frozen=True)
class LoopCheck:
    """Outcome of the verification of a pair of frames."""

    matches: Matches
    """Those that agree on one motion, whether or not the pair is accepted."""
    reason: str
    """Why the pair is rejected; empty where it is accepted."""
    shift_m: FloatArray
    """(2,) mean error of the predicted pose in frame a's horizontal plane, as estimated from the matches."""
    tolerance_m: float
    """Uncertainty of that error."""
    sure: bool = False
    """Whether the number of false alarms accepts the pair by itself; others need a consistent pair that is sure."""

    @property
    def accepted(self) -> bool:
        """Whether every test was passed."""
        return not self.reason


def reject_loop(matches: Matches, reason: str) -> LoopCheck:
    """Return the outcome for a pair that fails a test."""
    return LoopCheck(matches, reason, np.zeros(2), 0.0)


def are_mutually_consistent(first: LoopCheck, second: LoopCheck, window: int) -> bool:
    """Return whether two nearby loops, one of them sure, agree on the error of the predicted poses.

    Args:
        first, second: outcomes for two pairs of frames.
        window: largest distance in frames between the pairs, in either frame.
    """
    a, b = (abs(getattr(first.matches, name) - getattr(second.matches, name)) for name in ("frame_a", "frame_b"))
    apart_m = float(np.linalg.norm(first.shift_m - second.shift_m))
    agree = apart_m <= 2 * max(first.tolerance_m, second.tolerance_m)
    return (first.sure or second.sure) and a + b > 0 and max(a, b) <= window and agree
