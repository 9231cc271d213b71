"""Single wrong values in a row of readings: what stands alone against the running median of its neighbours."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from asfm.types import BoolArray, FloatArray

HALF_WINDOW = 4
"""Readings on each side that the running median looks at; a change that lasts as long is no spike."""
FEWEST = 2 * HALF_WINDOW
"""Among fewer readings nothing is typical."""
SIGMAS = 8.0
"""A reading farther than this many of its own sigmas from the running median, and as many of the typical distance
from it, is not believed."""
TO_SIGMA = 1.4826
"""A normal distribution's standard deviation over its median absolute deviation."""


def running_median(values: FloatArray, half_window: int = HALF_WINDOW) -> FloatArray:
    """Give the median (N, C) of each of (N, C) values and its neighbours; at the ends along their median slope."""
    half = min(half_window, (len(values) - 1) // 2)
    if half < 1:
        return values
    middle = np.median(sliding_window_view(values, 2 * half + 1, axis=0), axis=-1)
    begin, end = _level_line(values[: 2 * half + 1])[:half], _level_line(values[-2 * half - 1 :])[half + 1 :]
    return np.concatenate([begin, middle, end])


def _level_line(values: FloatArray) -> FloatArray:
    """Draw a line (N, C) through (N, C) values by the median of their differences and of what is left."""
    line = np.arange(len(values))[:, None] * np.median(np.diff(values, axis=0), axis=0)
    return np.asarray(line + np.median(values - line, axis=0))


def find_spikes(values: FloatArray, sigma: FloatArray | float) -> tuple[BoolArray, FloatArray]:
    """Find single wrong values, such as a depth of another metre between two alike.

    Args:
        values: (N, C) rows of readings; a trend of a few sigmas over the window does no harm.
        sigma: standard deviation of their noise, broadcast against the values.

    Returns:
        (N, C) which stand alone, (N, C) how far each lies from the running median of its neighbours.
    """
    away = np.abs(values - running_median(values))
    if len(values) < FEWEST:
        return np.zeros(values.shape, dtype=bool), away
    typical = TO_SIGMA * np.median(away, axis=0)
    return np.asarray(away > SIGMAS * np.maximum(sigma, typical)), away
