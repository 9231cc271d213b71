"""Planar-motion RANSAC: the motion in the horizontal plane that most matches of a frame pair agree with."""

from functools import lru_cache

import numpy as np

from asfm.config import Config
from asfm.geometry.feature_noise import relative_position_noise_m
from asfm.geometry.planar_motion import estimate_planar_motion_msac
from asfm.geometry.sonar import SonarModel
from asfm.types import BoolArray, FloatArray, IntArray, Keypoints

TRIAL_MATCHES = 18
"""Trial motions come from all 153 pairs of the cheapest matches: the search is deterministic."""
MIN_MATCHES = 4
"""Fewest matches that are tested: three agree on a planar motion too easily."""


def find_planar_outliers(
    xy_a: FloatArray, xy_b: FloatArray, tolerance_m: FloatArray, cost: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Find the planar motion of one pair of frames that most matches agree with, and its outliers.

    Args:
        xy_a: (M, 2) matched points of frame a at elevation zero, (r cos(theta), r sin(theta)), in metres.
        xy_b: (M, 2) the same of frame b.
        tolerance_m: (M,) largest distance of an inlier, above zero.
        cost: (M,) smaller is more reliable.

    Returns:
        (4, 4) a_from_b in the plane, (M,) true for outliers. Positions that are not finite are always outliers; with
        fewer than four finite ones no others are.
    """
    finite = np.isfinite(xy_a).all(axis=1) & np.isfinite(xy_b).all(axis=1)
    outlier = np.asarray(~finite)
    if finite.sum() < MIN_MATCHES:
        return np.eye(4), outlier
    trials = cheapest_pairs(cost[finite])
    motion, inlier = estimate_planar_motion_msac(xy_a[finite], xy_b[finite], tolerance_m[finite], trials)
    outlier[finite] = ~inlier
    return motion, outlier


def cheapest_pairs(cost: FloatArray, count: int = TRIAL_MATCHES) -> IntArray:
    """Return all pairs (T, 2) among the cheapest of (M,) matches."""
    chosen = np.argsort(cost, kind="stable")[:count]
    first, second = _all_pairs(len(chosen))
    return np.stack([chosen[first], chosen[second]], axis=1)


@lru_cache
def _all_pairs(count: int) -> tuple[IntArray, IntArray]:
    first, second = np.triu_indices(count, 1)
    return first, second


def planar_positions(keypoints: Keypoints, which: IntArray) -> FloatArray:
    """Return the (M, 2) x and y in metres of keypoints at elevation zero."""
    range_m, bearing_rad = keypoints.range_m[which], keypoints.bearing_rad[which]
    return np.stack([range_m * np.cos(bearing_rad), range_m * np.sin(bearing_rad)], axis=1)


def planar_tolerance_m(range_m: FloatArray, sonar: SonarModel, config: Config) -> FloatArray:
    """Return the largest distances (M,) of inliers at (M,) ranges: noise, or a share of the range for elevations."""
    noise_m = relative_position_noise_m(range_m, sonar, config.noise)
    return np.maximum(config.matching.planar_tolerance * range_m, noise_m)
