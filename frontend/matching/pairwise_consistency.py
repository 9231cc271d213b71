"""Pairwise consistency of matches: distances between points of a rigid scene agree within the bounds of a sonar.

Two points with ranges ri, rj, a bearing difference D and elevations ei, ej have a distance d with

    d^2 = ri^2 + rj^2 - 2 ri rj s,    s = cos ei cos ej cos D + sin ei sin ej
                                        = (1 + cos D) / 2 cos(ei - ej) - (1 - cos D) / 2 cos(ei + ej).

With |e| <= h, the sum and the difference of the elevations each reach 2h while the other is zero. Hence, for h <= 90
degrees, s lies between (1 + cos D) / 2 cos 2h - (1 - cos D) / 2 and (1 + cos D) / 2 - (1 - cos D) / 2 cos 2h. Both are
attained, so the bounds are exact.
"""

import numpy as np

from asfm.frontend.matching.max_clique import find_largest_clique
from asfm.types import BoolArray, FloatArray


def distance_bounds_m(
    range_m: FloatArray, bearing_rad: FloatArray, aperture_rad: float
) -> tuple[FloatArray, FloatArray]:
    """Compute the bounds of the distances between points of unknown elevation.

    Args:
        range_m: (M,) ranges.
        bearing_rad: (M,) bearings.
        aperture_rad: full elevation aperture.

    Returns:
        (M, M) lower and (M, M) upper bounds in metres.
    """
    cosine = np.cos(bearing_rad[:, None] - bearing_rad)
    product = range_m[:, None] * range_m
    squared_ranges = (range_m**2)[:, None] + range_m**2
    aperture_cosine = np.cos(min(aperture_rad, np.pi))
    lower = squared_ranges - product * ((1 + cosine) - (1 - cosine) * aperture_cosine)
    upper = squared_ranges - product * ((1 + cosine) * aperture_cosine - (1 - cosine))
    return np.sqrt(np.maximum(lower, 0.0)), np.sqrt(np.maximum(upper, 0.0))


def pairwise_distance_consistency(
    pixel_a: FloatArray, pixel_b: FloatArray, aperture_rad: float, slack_m: FloatArray
) -> BoolArray:
    """Return which pairs of matches can be two points of one rigid scene (Mangelson 2018).

    The bounds of the points' distance in the two frames must overlap.

    Args:
        pixel_a: (M, 2) range_m and bearing_rad of the matches in frame a.
        pixel_b: (M, 2) the same in frame b.
        aperture_rad: full elevation aperture.
        slack_m: (M,) tolerance for the noise of a point; those of two points add in quadrature.

    Returns:
        (M, M) symmetric, true on the diagonal.
    """
    lower_a, upper_a = distance_bounds_m(pixel_a[:, 0], pixel_a[:, 1], aperture_rad)
    lower_b, upper_b = distance_bounds_m(pixel_b[:, 0], pixel_b[:, 1], aperture_rad)
    slack = np.hypot(slack_m[:, None], slack_m)
    consistent = (lower_a <= upper_b + slack) & (lower_b <= upper_a + slack)
    np.fill_diagonal(consistent, True)
    return np.asarray(consistent)


def find_distance_outliers(
    pixel_a: FloatArray, pixel_b: FloatArray, aperture_rad: float, slack_m: FloatArray
) -> BoolArray:
    """Return the matches (M,) outside the largest set of pairwise consistent ones.

    Arguments are those of :func:`pairwise_distance_consistency`.
    """
    return ~find_largest_clique(pairwise_distance_consistency(pixel_a, pixel_b, aperture_rad, slack_m))
