"""Outlier rejection in a time series of readings by a robust local parabola (a Hampel-type filter).

Each reading is compared with a parabola fitted to its neighbours, and rejected where it lies farther away than the
noise and the median absolute deviation (MAD) allow (Hampel 1974, Pearson 2002).
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from asfm.types import BoolArray, FloatArray, IntArray

HALF_WINDOW = 4
"""Neighbours on each side; a change that lasts at least this many readings is not an outlier."""
MIN_READINGS = 2 * HALF_WINDOW
"""Shorter time series are not filtered."""
OUTLIER_SIGMAS = 8.0
"""A reading is an outlier beyond this many sigmas of its noise and of the MAD of the residuals."""
MAD_TO_SIGMA = 1.4826
"""A normal distribution's standard deviation over its median absolute deviation."""
MAX_NEIGHBOUR_DISTANCE = 2.5
"""Neighbours farther away than this many half windows at the median interval lie across a gap and are ignored."""
MIN_NEIGHBOURS = 5
"""Readings with fewer neighbours are not tested."""
FIT_ITERATIONS = 6
"""Iterations of the reweighted least squares that fit a parabola."""
END_NEIGHBOURS = 2
"""With fewer neighbours on one side the parabola extrapolates, and the change from the nearest ones is tested too."""
RATE_FACTOR = 3.0
"""A reading near an end must differ from its nearest neighbours by this many typical steps more than by the noise."""
MAX_PASSES = 20
"""Passes that remove the worst outlier of each neighbourhood."""


def running_median(values: FloatArray) -> FloatArray:
    """Return the (N, C) running median of (N, C) values; at the ends that of the last full window."""
    half = min(HALF_WINDOW, (len(values) - 1) // 2)
    if half < 1:
        return values
    middle = np.median(sliding_window_view(values, 2 * half + 1, axis=0), axis=-1)
    return np.asarray(middle[np.clip(np.arange(len(values)) - half, 0, len(middle) - 1)])


def find_outliers(
    values: FloatArray, sigma: FloatArray | float, stamps_s: FloatArray | None = None
) -> tuple[BoolArray, FloatArray]:
    """Find single outliers in a time series, such as one depth a metre off its neighbours.

    Each pass removes the worst outlier of every neighbourhood, and the others are tested again without it. Neighbours
    across a gap are ignored; readings with fewer than :data:`MIN_NEIGHBOURS` are not tested. At the ends, where the
    parabola extrapolates, an outlier must also change faster than its neighbours do.

    Args:
        values: (N, C) readings of C channels.
        sigma: standard deviation of their noise, broadcast against the values.
        stamps_s: (N,) rising time stamps; None for evenly spaced readings.

    Returns:
        (N, C) which readings are outliers, (N, C) absolute deviation of each from the parabola of its neighbours.
    """
    outlier = np.zeros(values.shape, dtype=bool)
    if len(values) < MIN_READINGS:
        return outlier, np.zeros(values.shape)
    window = _windows(len(values))
    time = _relative_times(window, np.arange(len(values), dtype=float) if stamps_s is None else stamps_s)
    deviation = np.abs(values - _fit_parabolas(values, outlier, window, time))
    limit = OUTLIER_SIGMAS * np.maximum(sigma, MAD_TO_SIGMA * np.median(deviation, axis=0))
    for _ in range(MAX_PASSES):
        usual = outlier | (_end_changes(values, outlier, window, time) <= limit)
        excess = np.where(usual, 0.0, deviation / limit)
        worst = (excess > 1) & (excess >= excess[window].max(axis=1))
        if not worst.any():
            break
        outlier |= worst
        deviation = np.where(outlier, deviation, np.abs(values - _fit_parabolas(values, outlier, window, time)))
    return np.asarray(outlier), np.asarray(deviation)


def _windows(count: int) -> IntArray:
    """Return the (N, W) indices of each value and its neighbours; windows at the ends are shifted, not shortened."""
    size = min(2 * HALF_WINDOW + 1, count)
    begin = np.clip(np.arange(count) - HALF_WINDOW, 0, count - size)
    return np.asarray(begin[:, None] + np.arange(size))


def _relative_times(window: IntArray, stamps_s: FloatArray) -> FloatArray:
    """Return the (N, W) times from each value to its neighbours, in half windows at the median interval."""
    interval_s = max(float(np.median(np.diff(stamps_s))), 1e-12)
    return np.asarray((stamps_s[window] - stamps_s[:, None]) / (HALF_WINDOW * interval_s))


def _end_changes(values: FloatArray, outlier: BoolArray, window: IntArray, time: FloatArray) -> FloatArray:
    """Return by how much (N, C) values near an end or a gap change beyond their rate; infinite elsewhere."""
    change = np.full(values.shape, np.inf)
    near = (window != np.arange(len(values))[:, None]) & (np.abs(time) <= MAX_NEIGHBOUR_DISTANCE)
    before, after = (near & (time < 0)).sum(axis=1), (near & (time > 0)).sum(axis=1)
    for index in np.flatnonzero(np.minimum(before, after) < END_NEIGHBOURS).tolist():
        others, times = window[index][near[index]], time[index][near[index]]
        for channel in range(values.shape[1]):
            usable = ~outlier[others, channel]
            if usable.sum() >= MIN_NEIGHBOURS:
                neighbours = values[others[usable], channel]
                change[index, channel] = _excess_change(values[index, channel], neighbours, times[usable])
    return change


def _excess_change(value: float, neighbours: FloatArray, time: FloatArray) -> float:
    """Return by how much a value differs from its nearest neighbours beyond what their typical rate explains.

    Args:
        value: reading at the time zero.
        neighbours: (W,) other readings.
        time: (W,) their rising times.
    """
    rate = float(np.median(np.abs(np.diff(neighbours) / np.maximum(np.diff(time), 1e-9))))
    sides = [np.flatnonzero(time < 0)[-1:], np.flatnonzero(time > 0)[:1]]
    nearest = np.concatenate(sides)
    excess = np.abs(value - neighbours[nearest]) - RATE_FACTOR * rate * np.abs(time[nearest])
    return max(float(excess.max()), 0.0)


def _fit_parabolas(values: FloatArray, outlier: BoolArray, window: IntArray, time: FloatArray) -> FloatArray:
    """Predict each value (N, C) from a parabola fitted to its neighbours with least absolute residuals (IRLS)."""
    index = np.arange(len(values))
    powers = np.stack([np.ones_like(time), time, time * time], axis=-1)  # (N, W, 3)
    neighbours = values[window]  # (N, W, C)
    near = (window != index[:, None]) & (np.abs(time) <= MAX_NEIGHBOUR_DISTANCE)
    usable = ~outlier[window] & near[..., None]
    weight = usable.astype(float)
    scale = np.maximum(np.ptp(values, axis=0), 1e-12)
    for _ in range(FIT_ITERATIONS):
        hessian = np.einsum("nwc,nwi,nwj->ncij", weight, powers, powers) + 1e-9 * np.eye(3)
        gradient = np.einsum("nwc,nwi,nwc->nci", weight, powers, neighbours)
        fit = np.linalg.solve(hessian, gradient[..., None])[..., 0]  # (N, C, 3)
        residual = np.abs(neighbours - np.einsum("nwi,nci->nwc", powers, fit))
        weight = usable / np.maximum(residual / scale, 1e-4)
    return np.asarray(np.where(usable.sum(axis=1) >= MIN_NEIGHBOURS, fit[..., 0], values))
