"""Feature noise estimated from matches: the spread of near frame pairs about a robust fit of their motion.

Between near frames all matched features move alike. What differs from feature to feature, after a planar motion and a
smooth trend over the image have been taken away, is the noise of two positions, the share that elevations and wrong
matches have in it being small for one and robustly ignored for the other.
"""

from collections.abc import Iterable

import numpy as np

from asfm.frontend.matching.planar_ransac import cheapest_pairs, planar_positions
from asfm.geometry.planar_motion import estimate_planar_motion_msac
from asfm.geometry.poses import wrap_angle
from asfm.types import BoolArray, FloatArray, IntArray, Keypoints, Matches

TOLERANCES_PER_RANGE = (0.03, 0.06, 0.12)
"""Distances of an inlier from the planar motion, over its range: the first that does not cut the noise off."""
FULL_QUANTILE, FULL_SHARE = 0.8, 0.65
"""The noise is cut off where this quantile of the inliers' distances exceeds this share of the largest distance: of
normal errors with a third of it as their standard deviation, it is 0.6."""
MIN_INLIERS, MIN_INLIER_SHARE = 12, 0.3
"""Frame pairs with fewer inliers, or a smaller share of their matches, tell nothing."""
MIN_PAIRS = 3
"""Fewest frame pairs from which the noise is estimated."""
QUANTILE = 0.25
"""Which of the frame pairs' spreads counts. Roll and pitch move features of different elevations apart and widen the
spread; the pairs with little of them show the noise."""
CAUCHY_SIGMAS = 2.0
"""Scale of the Cauchy weights in the fit of the trend."""
ITERATIONS = 6
"""Of that fit; it converges in three or four."""


def estimate_match_noise(pairs: Iterable[tuple[Keypoints, Keypoints, Matches]]) -> FloatArray | None:
    """Estimate the standard deviations of a feature's position from the matches of near frame pairs.

    The spread in each pair is 1.4826 times the median absolute residual, corrected for the parameters of the trend, and
    that of a feature is 1 / sqrt(2) of it. The result is the lower quartile over the pairs.

    Args:
        pairs: keypoints of frame a, those of frame b, and their matches; some may be wrong.

    Returns:
        (2,) of range_m and bearing_rad; None where fewer than :data:`MIN_PAIRS` pairs tell.
    """
    spreads = [spread for pair in pairs if (spread := _measure_spread(*pair)) is not None]
    if len(spreads) < MIN_PAIRS:
        return None
    return np.asarray(np.quantile(spreads, QUANTILE, axis=0) / np.sqrt(2.0))


def _measure_spread(a: Keypoints, b: Keypoints, matches: Matches) -> FloatArray | None:
    """Return the (2,) spreads of the differences in range_m and bearing_rad; None where too few matches agree."""
    in_a, in_b = matches.index.T
    if len(matches) < MIN_INLIERS:
        return None
    xy_a, xy_b = planar_positions(a, in_a), planar_positions(b, in_b)
    range_m, bearing_rad = a.range_m[in_a], a.bearing_rad[in_a]
    moved, inlier = _fit_motion(xy_a, xy_b, cheapest_pairs(matches.cost))
    if inlier.sum() < max(MIN_INLIERS, MIN_INLIER_SHARE * len(matches)):
        return None
    range_error_m = np.hypot(moved[:, 0], moved[:, 1]) - range_m
    bearing_error_rad = wrap_angle(np.arctan2(moved[:, 1], moved[:, 0]) - bearing_rad)
    trend = np.stack([np.ones(len(range_m)), bearing_rad, bearing_rad**2, range_m], axis=1)
    return np.array([_robust_spread(trend, error, inlier) for error in (range_error_m, bearing_error_rad)])


def _fit_motion(xy_a: FloatArray, xy_b: FloatArray, samples: IntArray) -> tuple[FloatArray, BoolArray]:
    """Return the (M, 2) points of frame b moved into frame a by the planar motion of most, and which agree with it."""
    range_m = np.hypot(xy_a[:, 0], xy_a[:, 1])
    for tolerance in TOLERANCES_PER_RANGE:
        motion, inlier = estimate_planar_motion_msac(xy_a, xy_b, tolerance * range_m, samples)
        moved = xy_b @ motion[:2, :2].T + motion[:2, 3]
        share = np.hypot(*(moved - xy_a).T) / (tolerance * range_m)
        if inlier.any() and np.quantile(share[inlier], FULL_QUANTILE) <= FULL_SHARE:
            break
    return moved, inlier


def _robust_spread(trend: FloatArray, error: FloatArray, inlier: BoolArray) -> float:
    """Return the spread of the inliers' (M,) errors about a linear model (M, P), fitted with Cauchy weights."""
    trend, error = trend[inlier], error[inlier]
    weight, spread = np.ones(len(error)), 0.0
    for _ in range(ITERATIONS):
        root = np.sqrt(weight)
        coefficients = np.linalg.lstsq(trend * root[:, None], error * root, rcond=None)[0]
        residual = error - trend @ coefficients
        spread = 1.4826 * float(np.median(np.abs(residual)))
        if spread <= 0:
            break
        weight = 1 / (1 + (residual / (CAUCHY_SIGMAS * spread)) ** 2)
    return spread * float(np.sqrt(len(error) / (len(error) - trend.shape[1])))
