"""Single wrong values in a row of readings: what stands alone against a smooth curve through its neighbours."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from asfm.types import BoolArray, FloatArray, IntArray

HALF_WINDOW = 4
"""Readings on each side that are looked at; a change that lasts as long is no spike."""
FEWEST = 2 * HALF_WINDOW
"""Among fewer readings nothing is typical."""
SIGMAS = 8.0
"""A reading farther than this many of its own sigmas from the curve, and as many of the typical distance from it, is
not believed."""
MAD_TO_SIGMA = 1.4826
"""A normal distribution's standard deviation over its median absolute deviation."""
REACH = 2.5
"""Neighbours that are farther away than this many usual half windows lie across a gap."""
MIN_NEIGHBOURS = 5
REWEIGHTINGS = 6
PASSES = 20


def running_median(values: FloatArray) -> FloatArray:
    """Give the median (N, C) of each of (N, C) values and its neighbours; at the ends that of the last full window."""
    half = min(HALF_WINDOW, (len(values) - 1) // 2)
    if half < 1:
        return values
    middle = np.median(sliding_window_view(values, 2 * half + 1, axis=0), axis=-1)
    return np.asarray(middle[np.clip(np.arange(len(values)) - half, 0, len(middle) - 1)])


def find_outliers(
    values: FloatArray, sigma: FloatArray | float, stamps_s: FloatArray | None = None
) -> tuple[BoolArray, FloatArray]:
    """Find single wrong values, such as a depth of another metre between two alike.

    Each value is compared with a parabola through its neighbours. The worst of each neighbourhood goes first, and the
    others are judged without it. Neighbours across a gap do not count, and who has few of them is not judged.

    Args:
        values: (N, C) rows of readings.
        sigma: standard deviation of their noise, broadcast against the values.
        stamps_s: (N,) when they were made, rising; evenly without.

    Returns:
        (N, C) which stand alone, (N, C) how far each lies from its neighbours.
    """
    wrong = np.zeros(values.shape, dtype=bool)
    if len(values) < FEWEST:
        return wrong, np.zeros(values.shape)
    window = _windows(len(values))
    apart = _apart(window, np.arange(len(values), dtype=float) if stamps_s is None else stamps_s)
    away = np.abs(values - _predict(values, wrong, window, apart))
    limit = SIGMAS * np.maximum(sigma, MAD_TO_SIGMA * np.median(away, axis=0))
    for _ in range(PASSES):
        excess = np.where(wrong, 0.0, away / limit)
        worst = (excess > 1) & (excess >= excess[window].max(axis=1))
        if not worst.any():
            break
        wrong |= worst
        away = np.where(wrong, away, np.abs(values - _predict(values, wrong, window, apart)))
    return np.asarray(wrong), np.asarray(away)


def _windows(count: int) -> IntArray:
    """Indices (N, W) of each value and its neighbours, as many at the ends as in the middle."""
    size = min(2 * HALF_WINDOW + 1, count)
    begin = np.clip(np.arange(count) - HALF_WINDOW, 0, count - size)
    return np.asarray(begin[:, None] + np.arange(size))


def _apart(window: IntArray, stamps_s: FloatArray) -> FloatArray:
    """Times (N, W) from each value to its neighbours, over half a usual window."""
    usual_s = max(float(np.median(np.diff(stamps_s))), 1e-12)
    return np.asarray((stamps_s[window] - stamps_s[:, None]) / (HALF_WINDOW * usual_s))


def _predict(values: FloatArray, wrong: BoolArray, window: IntArray, apart: FloatArray) -> FloatArray:
    """Read each value (N, C) off the parabola through its neighbours that has the least absolute distance from them."""
    index = np.arange(len(values))
    powers = np.stack([np.ones_like(apart), apart, apart * apart], axis=-1)  # (N, W, 3)
    seen = values[window]  # (N, W, C)
    near = (window != index[:, None]) & (np.abs(apart) <= REACH)
    usable = ~wrong[window] & near[..., None]
    weight = usable.astype(float)
    scale = np.maximum(np.ptp(values, axis=0), 1e-12)
    for _ in range(REWEIGHTINGS):
        hessian = np.einsum("nwc,nwi,nwj->ncij", weight, powers, powers) + 1e-9 * np.eye(3)
        gradient = np.einsum("nwc,nwi,nwc->nci", weight, powers, seen)
        fit = np.linalg.solve(hessian, gradient[..., None])[..., 0]  # (N, C, 3)
        distance = np.abs(seen - np.einsum("nwi,nci->nwc", powers, fit))
        weight = usable / np.maximum(distance / scale, 1e-4)
    return np.asarray(np.where(usable.sum(axis=1) >= MIN_NEIGHBOURS, fit[..., 0], values))
