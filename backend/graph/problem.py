"""Bundle adjustment problem: tracks, sensor constraints and sigmas, and the keys of the factor graph."""

from dataclasses import dataclass

import gtsam

from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.types import BoolArray, FloatArray, Tracks

FIRST_POSE = gtsam.symbol("x", 0)
FIRST_POINT = gtsam.symbol("l", 0)
"""Keys in a graph: FIRST_POSE + frame of a pose, FIRST_POINT + track of a point."""


@dataclass(frozen=True)
class BundleProblem:
    """Input of one bundle adjustment."""

    tracks: Tracks
    observed: BoolArray
    """(O,) whether each observation enters the graph."""
    sigma: FloatArray
    """(O, 2) standard deviations of range_m and bearing_rad."""
    sensors: SensorConstraints
    vehicle_from_sonar: FloatArray
    """(4, 4) lever arm."""
    half_aperture_rad: float
    """Half of the elevation aperture: points lie at elevations of at most this size."""
