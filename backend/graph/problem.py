"""What one adjustment of poses and points is given."""

from dataclasses import dataclass

import gtsam

from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.types import BoolArray, FloatArray, Tracks

FIRST_POSE = gtsam.symbol("x", 0)
FIRST_POINT = gtsam.symbol("l", 0)
"""Keys of the poses and points in a graph follow from these."""


@dataclass(frozen=True)
class BundleProblem:
    """Tracks, sensors and weights of one adjustment."""

    tracks: Tracks
    observed: BoolArray
    """(O,) which observations enter the graph."""
    sigma: FloatArray
    """(O, 2) standard deviations of range_m and bearing_rad."""
    sensors: SensorConstraints
    vehicle_from_sonar: FloatArray
    """(4, 4) lever arm."""
    half_aperture_rad: float
