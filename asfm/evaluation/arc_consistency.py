"""A judge of matches that knows the poses but no elevation: does the second keypoint lie on the first one's arc?"""

import numpy as np

from asfm.geometry.poses import transform
from asfm.geometry.sonar import SonarModel, project
from asfm.types import BoolArray, FloatArray

RANGE_TOLERANCE_M = 0.02
BEARING_TOLERANCE_RAD = float(np.radians(2.0))
ELEVATIONS = 33
"""Between two of them an arc is taken as straight: with 30 degrees of aperture at 10 m that is true to 0.3 mm."""


def fits_arc(
    range_a_m: FloatArray,
    bearing_a_rad: FloatArray,
    range_b_m: FloatArray,
    bearing_b_rad: FloatArray,
    sonar_b_from_sonar_a: FloatArray,
    sonar: SonarModel,
    range_tolerance_m: float = RANGE_TOLERANCE_M,
    bearing_tolerance_rad: float = BEARING_TOLERANCE_RAD,
) -> BoolArray:
    """Tell which of (M,) matches fit at some elevation inside the aperture: range and bearing within tolerance.

    A right match always fits; a wrong one may by chance, so this is an upper bound of the precision.

    Args:
        range_a_m: (M,), as are the other three; a keypoint of frame a with its partner in frame b.
        bearing_a_rad: (M,).
        range_b_m: (M,).
        bearing_b_rad: (M,).
        sonar_b_from_sonar_a: (4, 4), or (M, 4, 4) one a match.
        sonar: gives the aperture.
        range_tolerance_m: largest error in range.
        bearing_tolerance_rad: largest error in bearing.
    """
    arc_a_m = sonar.elevation_arc(range_a_m, bearing_a_rad, ELEVATIONS)
    range_m, bearing_rad, _ = project(transform(sonar_b_from_sonar_a[..., None, :, :], arc_a_m))
    turn_rad = np.remainder(bearing_rad - np.asarray(bearing_b_rad)[:, None] + np.pi, 2 * np.pi) - np.pi
    turn_rad = np.unwrap(turn_rad, axis=1)  # a jump from pi to -pi behind the sonar must not count as passing zero
    enter_range, leave_range = _stretch_within((range_m - np.asarray(range_b_m)[:, None]) / range_tolerance_m)
    enter_bearing, leave_bearing = _stretch_within(turn_rad / bearing_tolerance_rad)
    enter = np.maximum(np.maximum(enter_range, enter_bearing), 0.0)
    leave = np.minimum(np.minimum(leave_range, leave_bearing), 1.0)
    return np.asarray((enter <= leave).any(axis=1))


def _stretch_within(error: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Find where (M, E) errors, taken as linear between neighbours, lie in -1..1.

    Returns:
        enter and leave, each (M, E - 1), as fractions of the way to the next neighbour; beyond 0..1 is outside.
    """
    start, slope = error[:, :-1], np.diff(error, axis=1)
    slope = np.where(np.abs(slope) < 1e-12, 1e-12, slope)
    ends = np.stack([(-1.0 - start) / slope, (1.0 - start) / slope])
    return ends.min(axis=0), ends.max(axis=0)
