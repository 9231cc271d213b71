"""How noisy the tracks are, as their own residuals say: each beside the typical one, and all from frame to frame."""

import numpy as np

from asfm.types import BoolArray, FloatArray, IntArray

PRIOR_FREEDOM = 10.0
"""Degrees of freedom that the typical track's residuals count as, when a track's own are weighed against them."""
NARROWEST, WIDEST = 0.5, 3.0
"""A track's noise over that of the typical one is not believed beyond these."""
UNKNOWNS = 3
"""A point has as many coordinates, which its residuals have been fitted with."""
LAGS = 3
"""Errors of features last about so many frames."""
LONG = 8
"""Shorter tracks do not tell whether errors last."""
MAX_AUTOCORRELATION = 0.9
"""Correlation of neighbouring errors that is not believed to be exceeded."""


def estimate_track_noise(track: IntArray, observed: BoolArray, residual: FloatArray, lags: int = 0) -> FloatArray:
    """Compare the residuals of each track with those of the typical track.

    Features that slide, along an edge or around something round, agree worse with one point than others do, however
    sharp they look, and their errors last from frame to frame. With lags, what counts is therefore the variance of the
    mean of many residuals (the long-run variance of Newey and West 1987, Bartlett weights). Tracks of few observations
    stay near the typical one: the estimate is the root of the posterior variance under an inverse chi-square prior of
    :data:`PRIOR_FREEDOM` degrees.

    Args:
        track: (O,) number of each observation's track, rising.
        observed: (O,) which observations count.
        residual: (O, 2) whitened residuals of range and bearing.
        lags: observations so far apart in a track count as having errors in common.

    Returns:
        (T,) standard deviation over the typical one, 1 for tracks without observations.
    """
    count = int(track[-1]) + 1 if len(track) else 0
    views = np.bincount(track, observed, minlength=count)
    squares = _sum_long_run(track[observed], residual[observed], count, lags)
    freedom = np.maximum(2 * views - UNKNOWNS, 0)
    told = freedom > 0
    typical = float(np.median(squares[told] / freedom[told])) if told.any() else 0.0
    if typical <= 0:
        return np.ones(count)
    variance = (PRIOR_FREEDOM * typical + squares) / ((PRIOR_FREEDOM + freedom) * typical)
    return np.where(told, np.clip(np.sqrt(variance), NARROWEST, WIDEST), 1.0)


def autocorrelation_inflation(track: IntArray, observed: BoolArray, residual: FloatArray) -> FloatArray:
    """Measure by how much more the mean of many errors scatters than if each were new.

    With a correlation rho of neighbouring errors that fades geometrically, that is sqrt((1 + rho) / (1 - rho)). The
    fit of a point takes the mean out of a track's residuals, and with it about 1 / n of the correlation.

    Args:
        track: (O,) number of each observation's track, rising.
        observed: (O,) which observations count.
        residual: (O, 2) residuals of range and bearing.

    Returns:
        (2,) for range and bearing, at least 1; 1 where no track is long enough to tell.
    """
    track, residual = track[observed], residual[observed]
    views = np.bincount(track)[track] if len(track) else np.zeros(0)
    long = views >= LONG
    power = np.sum(residual[long] ** 2, axis=0)
    if not long.any() or not power.all():
        return np.ones(2)
    next_to = (track[1:] == track[:-1]) & long[1:]
    together = np.mean((residual[1:] * residual[:-1])[next_to], axis=0) / (power / np.count_nonzero(long))
    memory = np.clip(together + 1 / np.mean(views[long]), 0, MAX_AUTOCORRELATION)
    return np.asarray(np.sqrt((1 + memory) / (1 - memory)))


def _sum_long_run(track: IntArray, residual: FloatArray, count: int, lags: int) -> FloatArray:
    """Sum squares and weighted products of neighbours, track by track: (T,), never negative."""
    total = np.bincount(track, (residual**2).sum(axis=1), minlength=count)
    for lag in range(1, lags + 1):
        same = track[lag:] == track[:-lag]
        product = (residual[lag:] * residual[:-lag]).sum(axis=1)
        total = total + 2 * (1 - lag / (lags + 1)) * np.bincount(track[lag:][same], product[same], minlength=count)
    return np.maximum(total, 0.0)
