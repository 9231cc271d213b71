"""Arc consistency of matches: whether the second keypoint lies on the first one's elevation arc under known poses.

For sequences with true poses but without true elevations: a wrong match may fit by chance, and a correct one fits
within the tolerance. This tolerance is narrower in range than the one against true elevations
(:data:`asfm.evaluation.true_positions.TRUTH_TOLERANCE`), so that the inlier ratio may lie below the precision.
"""

from dataclasses import dataclass

import numpy as np

from asfm.geometry.poses import transform, wrap_angle
from asfm.geometry.sonar import SonarModel, project
from asfm.types import BoolArray, FloatArray


@dataclass(frozen=True)
class Tolerance:
    """Largest error of a keypoint that still agrees with its expected position."""

    range_m: float
    bearing_rad: float


ARC_TOLERANCE = Tolerance(0.02, float(np.radians(2.0)))
ARC_POINTS = 33
"""Points of an arc, taken as straight between neighbours: with 30 degrees of aperture at 10 m within 0.3 mm."""
MIN_SLOPE = 1e-12
"""Smaller differences of neighbouring errors are raised to this, to divide by."""


def find_arc_inliers(
    pixel_a: FloatArray,
    pixel_b: FloatArray,
    sonar_b_from_sonar_a: FloatArray,
    sonar: SonarModel,
    tolerance: Tolerance = ARC_TOLERANCE,
) -> BoolArray:
    """Return which of (M,) matches have an elevation inside the aperture at which range and bearing agree.

    Args:
        pixel_a: (M, 2) range_m and bearing_rad of the keypoints in frame a.
        pixel_b: (M, 2) range_m and bearing_rad of their partners in frame b.
        sonar_b_from_sonar_a: (4, 4), or (M, 4, 4) one a match.
        sonar: elevation aperture.
        tolerance: largest errors in range and bearing.
    """
    arc_a_m = sonar.elevation_arc(pixel_a[:, 0], pixel_a[:, 1], ARC_POINTS)
    range_m, bearing_rad, _ = project(transform(sonar_b_from_sonar_a[..., None, :, :], arc_a_m))
    bearing_error_rad = wrap_angle(bearing_rad - pixel_b[:, None, 1])
    # A jump from pi to -pi behind the sonar is not a zero crossing.
    bearing_error_rad = np.unwrap(bearing_error_rad, axis=1)
    enter_range, leave_range = _interval_within((range_m - pixel_b[:, None, 0]) / tolerance.range_m)
    enter_bearing, leave_bearing = _interval_within(bearing_error_rad / tolerance.bearing_rad)
    enter = np.maximum(np.maximum(enter_range, enter_bearing), 0.0)
    leave = np.minimum(np.minimum(leave_range, leave_bearing), 1.0)
    return np.asarray((enter <= leave).any(axis=1))


def _interval_within(error: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Find where (M, E) errors, linear between neighbours, lie in -1..1.

    Returns:
        Begin and end of the interval, each (M, E - 1), as fractions of the segment to the next neighbour; beyond 0..1
        is outside the segment.
    """
    first, slope = error[:, :-1], np.diff(error, axis=1)
    slope = np.where(np.abs(slope) < MIN_SLOPE, MIN_SLOPE, slope)
    ends = np.stack([(-1.0 - first) / slope, (1.0 - first) / slope])
    return ends.min(axis=0), ends.max(axis=0)
