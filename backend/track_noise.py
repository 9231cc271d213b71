"""How noisy each track is, as its own residuals say."""

import numpy as np

from asfm.types import BoolArray, FloatArray, IntArray

PRIOR_FREEDOM = 10.0
"""Degrees of freedom that the typical track's residuals count as, when a track's own are weighed against them."""
NARROWEST, WIDEST = 0.5, 3.0
"""A track's noise over that of the typical one is not believed beyond these."""
UNKNOWNS = 3
"""A point has as many coordinates, which its residuals have been fitted with."""


def estimate_track_noise(track: IntArray, observed: BoolArray, residual: FloatArray) -> FloatArray:
    """Compare the residuals of each track with those of the typical track.

    Features that slide, along an edge or around something round, agree worse with one point than others do, however
    sharp they look. Residuals also hold the errors of the poses, which all tracks share; so only the comparison with
    the typical track counts. Tracks of few observations stay near it: the estimate is the root of the posterior
    variance under an inverse chi-square prior of :data:`PRIOR_FREEDOM` degrees.

    Args:
        track: (O,) number of each observation's track.
        observed: (O,) which observations count.
        residual: (O, 2) whitened residuals of range and bearing.

    Returns:
        (T,) standard deviation over the typical one, 1 for tracks without observations.
    """
    count = int(track[-1]) + 1 if len(track) else 0
    views = np.bincount(track, observed, minlength=count)
    squares = np.bincount(track, observed * (residual**2).sum(axis=1), minlength=count)
    freedom = np.maximum(2 * views - UNKNOWNS, 0)
    told = freedom > 0
    typical = float(np.median(squares[told] / freedom[told])) if told.any() else 0.0
    if typical <= 0:
        return np.ones(count)
    variance = (PRIOR_FREEDOM * typical + squares) / ((PRIOR_FREEDOM + freedom) * typical)
    return np.where(told, np.clip(np.sqrt(variance), NARROWEST, WIDEST), 1.0)
