"""Noise of tracks estimated from their residuals: relative variance, and inflation by autocorrelation (AR(1))."""

import numpy as np

from asfm.types import BoolArray, FloatArray, IntArray

PRIOR_DEGREES_OF_FREEDOM = 10.0
"""Weight of the median variance, the prior, against the residuals of a track."""
MIN_NOISE_RATIO, MAX_NOISE_RATIO = 0.5, 3.0
"""Bounds of a track's standard deviation over the median one."""
POINT_PARAMETERS = 3
"""Degrees of freedom that the fit of a point takes from the residuals of its track."""
MAX_LAG = 3
"""Observations over which errors of features are correlated."""
MIN_TRACK_LENGTH = 8
"""Shorter tracks are not used to estimate the autocorrelation."""
MAX_AUTOCORRELATION = 0.9
"""Upper bound of the estimated correlation of consecutive errors."""


def estimate_track_noise(track: IntArray, observed: BoolArray, residual: FloatArray, lags: int = 0) -> FloatArray:
    """Estimate the standard deviation of each track's residuals relative to that of the median track.

    Features that slide along an edge or around a round object fit a single point worse than others, and their errors
    are correlated from frame to frame. With lags the estimate is therefore the long-run variance, that of the mean of
    many residuals (Newey and West 1987, Bartlett weights). Tracks with few observations stay near the median: the
    estimate is the root of the posterior variance under a scaled inverse chi-square prior with
    :data:`PRIOR_DEGREES_OF_FREEDOM`.

    Args:
        track: (O,) number of each observation's track, rising.
        observed: (O,) which observations are used.
        residual: (O, 2) whitened residuals of range and bearing.
        lags: largest distance, in observations of a track, at which errors are correlated.

    Returns:
        (T,) standard deviation over that of the median track, 1 for tracks without observations.
    """
    count = int(track[-1]) + 1 if len(track) else 0
    views = np.bincount(track, observed, minlength=count)
    squares = _long_run_squares(track[observed], residual[observed], count, lags)
    freedom = np.maximum(2 * views - POINT_PARAMETERS, 0)
    known = freedom > 0
    typical = float(np.median(squares[known] / freedom[known])) if known.any() else 0.0
    if typical <= 0:
        return np.ones(count)
    prior = PRIOR_DEGREES_OF_FREEDOM
    variance = (prior * typical + squares) / ((prior + freedom) * typical)
    return np.where(known, np.clip(np.sqrt(variance), MIN_NOISE_RATIO, MAX_NOISE_RATIO), 1.0)


def autocorrelation_inflation(track: IntArray, observed: BoolArray, residual: FloatArray) -> FloatArray:
    """Estimate the factor by which autocorrelated errors increase the standard deviation of a track's mean error.

    For a first-order autoregressive process, AR(1), with correlation rho of consecutive errors, the factor is
    sqrt((1 + rho) / (1 - rho)). The fit of a point removes the mean of a track's n residuals, which lowers their
    correlation by about 1 / n; that is added back.

    Args:
        track: (O,) number of each observation's track, rising.
        observed: (O,) which observations are used.
        residual: (O, 2) residuals of range and bearing.

    Returns:
        (2,) factors for range and bearing, at least 1; 1 where no track has :data:`MIN_TRACK_LENGTH` observations.
    """
    track, residual = track[observed], residual[observed]
    views = np.bincount(track)[track] if len(track) else np.zeros(0)
    long = views >= MIN_TRACK_LENGTH
    power = np.sum(residual[long] ** 2, axis=0)
    if not long.any() or not power.all():
        return np.ones(2)
    consecutive = (track[1:] == track[:-1]) & long[1:]
    correlation = np.mean((residual[1:] * residual[:-1])[consecutive], axis=0) / (power / np.count_nonzero(long))
    rho = np.clip(correlation + 1 / np.mean(views[long]), 0, MAX_AUTOCORRELATION)
    return np.asarray(np.sqrt((1 + rho) / (1 - rho)))


def _long_run_squares(track: IntArray, residual: FloatArray, count: int, lags: int) -> FloatArray:
    """Return the (T,) sums of squares plus Bartlett-weighted products at each lag, at least 0."""
    total = np.bincount(track, (residual**2).sum(axis=1), minlength=count)
    for lag in range(1, lags + 1):
        same = track[lag:] == track[:-lag]
        product = (residual[lag:] * residual[:-lag]).sum(axis=1)
        total = total + 2 * (1 - lag / (lags + 1)) * np.bincount(track[lag:][same], product[same], minlength=count)
    return np.maximum(total, 0.0)
