"""Planar filter: matches that agree on one motion in the plane, as far as unknown elevations allow."""

from functools import lru_cache

import numpy as np

from asfm.geometry.planar_motion import estimate_planar_motion_msac
from asfm.types import BoolArray, FloatArray, IntArray, Keypoints

SUREST = 18
"""Trial motions come from the pairs of this many surest matches: all 153 of them, and no chance is involved."""
FEWEST = 4
"""Three matches agree on a planar motion too easily: fewer than this are not judged."""


def find_planar_outliers(
    xy_a: FloatArray, xy_b: FloatArray, tolerance_m: FloatArray, cost: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Find the planar motion of one pair of frames that most matches agree with, and who does not.

    Args:
        xy_a, xy_b: (M, 2) the matched points at elevation zero, (r cos(theta), r sin(theta)).
        tolerance_m: (M,) how far an agreeing point may lie, above zero.
        cost: (M,) smaller is surer.

    Returns:
        (4, 4) a_from_b in the plane, (M,) true where a match disagrees. Of fewer than four matches none disagrees;
        a place that is not finite always does.
    """
    finite = np.isfinite(xy_a).all(axis=1) & np.isfinite(xy_b).all(axis=1)
    outlier = np.asarray(~finite)
    if finite.sum() < FEWEST:
        return np.eye(4), outlier
    picks = pick_surest_pairs(cost[finite])
    motion, agrees = estimate_planar_motion_msac(xy_a[finite], xy_b[finite], tolerance_m[finite], picks)
    outlier[finite] = ~agrees
    return motion, outlier


def pick_surest_pairs(cost: FloatArray, count: int = SUREST) -> IntArray:
    """FramePair up the surest of (M,) matches, each with each: (T, 2)."""
    surest = np.argsort(cost, kind="stable")[:count]
    first, second = _every_pair(len(surest))
    return np.stack([surest[first], surest[second]], axis=1)


@lru_cache
def _every_pair(count: int) -> tuple[IntArray, IntArray]:
    first, second = np.triu_indices(count, 1)
    return first, second


def place_in_plane(keypoints: Keypoints, which: IntArray) -> FloatArray:
    """Put keypoints at elevation zero: (M, 2) x and y in metres."""
    range_m, bearing_rad = keypoints.range_m[which], keypoints.bearing_rad[which]
    return np.stack([range_m * np.cos(bearing_rad), range_m * np.sin(bearing_rad)], axis=1)
