"""Length consistency: a rigid scene keeps its points' distances, and a sonar bounds each of them.

Two points at ranges ri, rj, bearings apart by D and elevations ei, ej are apart by d with

    d^2 = ri^2 + rj^2 - 2 ri rj s,    s = cos ei cos ej cos D + sin ei sin ej
                                        = (1 + cos D) / 2 cos(ei - ej) - (1 - cos D) / 2 cos(ei + ej).

With |e| <= h the sum and the difference of the elevations reach 2h, each while the other is zero. Hence, for h <= 90
degrees, s lies between (1 + cos D) / 2 cos 2h - (1 - cos D) / 2 and (1 + cos D) / 2 - (1 - cos D) / 2 cos 2h, and both
are reached: the bounds are exact.
"""

import numpy as np

from asfm.frontend.matching.max_clique import find_largest_clique
from asfm.types import BoolArray, FloatArray


def bound_lengths(range_m: FloatArray, bearing_rad: FloatArray, aperture_rad: float) -> tuple[FloatArray, FloatArray]:
    """Bound the distances between (M,) points of unknown elevation: least and greatest, each (M, M), in metres."""
    cosine = np.cos(bearing_rad[:, None] - bearing_rad)
    product = range_m[:, None] * range_m
    squares = (range_m**2)[:, None] + range_m**2
    swing = np.cos(min(aperture_rad, np.pi))
    least = squares - product * ((1 + cosine) - (1 - cosine) * swing)
    greatest = squares - product * ((1 + cosine) * swing - (1 - cosine))
    return np.sqrt(np.maximum(least, 0.0)), np.sqrt(np.maximum(greatest, 0.0))


def pairwise_distance_consistency(
    pixel_a: FloatArray, pixel_b: FloatArray, aperture_rad: float, slack_m: FloatArray
) -> BoolArray:
    """Tell which pairs of matches may be two points of one rigid scene: their lengths' bounds overlap.

    Args:
        pixel_a, pixel_b: (M, 2) range_m and bearing_rad of the matches in the two frames.
        aperture_rad: full opening in elevation.
        slack_m: (M,) how far noise may move a point; the slacks of a pair's two points add as squares.

    Returns:
        (M, M) symmetric, true on the diagonal.
    """
    least_a, greatest_a = bound_lengths(pixel_a[:, 0], pixel_a[:, 1], aperture_rad)
    least_b, greatest_b = bound_lengths(pixel_b[:, 0], pixel_b[:, 1], aperture_rad)
    slack = np.hypot(slack_m[:, None], slack_m)
    consistent = (least_a <= greatest_b + slack) & (least_b <= greatest_a + slack)
    np.fill_diagonal(consistent, True)
    return np.asarray(consistent)


def find_distance_outliers(
    pixel_a: FloatArray, pixel_b: FloatArray, aperture_rad: float, slack_m: FloatArray
) -> BoolArray:
    """Find the (M,) matches outside the largest set whose distances all agree.

    See :func:`pairwise_distance_consistency`.
    """
    return ~find_largest_clique(pairwise_distance_consistency(pixel_a, pixel_b, aperture_rad, slack_m))
