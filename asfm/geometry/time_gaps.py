"""Gaps between time stamps, and how far readings may be interpolated across them."""

import numpy as np

from asfm.types import FloatArray, IntArray

MAX_GAP_S = 1.0
MAX_GAP_INTERVALS = 3.0
"""Readings are interpolated across at most this time or this many of their median intervals, whichever is longer."""
SAME_TIME_S = 1e-9
"""Stamps closer than this are the same."""


def median_interval_s(stamps_s: FloatArray, otherwise_s: float = MAX_GAP_S) -> float:
    """Return the median interval between (R,) rising stamps, or another value where there are fewer than two."""
    return float(np.median(np.diff(stamps_s))) if len(stamps_s) > 1 else otherwise_s


def longest_bridge_s(interval_s: float) -> float:
    """Return the longest gap across which readings with a median interval may be interpolated."""
    return max(MAX_GAP_S, MAX_GAP_INTERVALS * interval_s)


def measure_gaps(reading_s: FloatArray, at_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Measure how near readings are to given times.

    Args:
        reading_s: (R,) rising stamps of the readings, R >= 1.
        at_s: (M,) times.

    Returns:
        (M,) time to the nearest reading, and (M,) time between the readings before and after; infinite outside.
    """
    before_s, after_s = (reading_s[index] for index in _neighbours(reading_s, at_s))
    between = (at_s >= before_s) & (at_s <= after_s)
    nearest_s = np.abs(at_s - nearest_stamps(reading_s, at_s))
    return nearest_s, np.where(between, after_s - before_s, np.inf)


def nearest_stamps(reading_s: FloatArray, at_s: FloatArray) -> FloatArray:
    """Return the nearest of (R,) rising stamps, R >= 1, to each of (M,) times, the earlier of two as near."""
    before_s, after_s = (reading_s[index] for index in _neighbours(reading_s, at_s))
    return np.asarray(np.where(np.abs(at_s - before_s) <= np.abs(after_s - at_s), before_s, after_s))


def _neighbours(reading_s: FloatArray, at_s: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the indices (M,) of the readings before and after each time, those of the nearest end outside."""
    after = np.clip(np.searchsorted(reading_s, at_s), 1, max(len(reading_s) - 1, 1))
    return after - 1, np.minimum(after, len(reading_s) - 1)
