"""Calibration parameters that the score test examines, with the deviations that are ordinary in practice."""

from dataclasses import dataclass

import numpy as np

DEGREE_RAD = float(np.deg2rad(1.0))


@dataclass(frozen=True)
class CalibrationParameter:
    """One parameter; at zero, what the recording states is right."""

    name: str
    tolerance: float
    """Deviation that is ordinary, in the internal unit (m, rad, s or a ratio): it is not reported."""
    prior_sigma: float
    """Standard deviation of the error before anything was measured: without it, a parameter that the motion hardly
    determines would take any value."""
    positive: str
    """What a positive value means."""
    negative: str
    unit: str = "m"
    """Of messages."""
    unit_size: float = 1.0
    """Internal units in one unit of messages."""


def _ratio(name: str, tolerance: float, prior_sigma: float, positive: str, negative: str) -> CalibrationParameter:
    return CalibrationParameter(name, tolerance, prior_sigma, positive, negative, "%", 0.01)


def _angle(name: str, positive: str, negative: str) -> CalibrationParameter:
    return CalibrationParameter(name, 2 * DEGREE_RAD, 8 * DEGREE_RAD, positive, negative, "deg", DEGREE_RAD)


def _length(name: str, tolerance_m: float, positive: str, negative: str) -> CalibrationParameter:
    return CalibrationParameter(name, tolerance_m, 0.3, positive, negative)


def _delay(name: str, positive: str, negative: str) -> CalibrationParameter:
    return CalibrationParameter(name, 0.1, 0.5, positive, negative, "s")


PARAMETERS = (
    _ratio("range_scale", 0.03, 0.1, "ranges are stated too long", "ranges are stated too short"),
    _length("range_bias", 0.05, "all ranges are stated too long", "all ranges are stated too short"),
    _ratio("bearing_scale", 0.04, 0.2, "bearings are stated too wide", "bearings are stated too narrow"),
    _angle("mounting_roll", "the sonar is rolled to starboard", "the sonar is rolled to port"),
    _angle("mounting_pitch", "the sonar looks lower than stated", "the sonar looks higher than stated"),
    _angle("mounting_yaw", "the sonar looks more to port than stated", "the sonar looks more to starboard than stated"),
    _length("lever_x", 0.1, "the sonar sits further ahead than stated", "the sonar sits further astern than stated"),
    _length("lever_y", 0.1, "the sonar sits further to port", "the sonar sits further to starboard"),
    _length("lever_z", 0.1, "the sonar sits higher than stated", "the sonar sits lower than stated"),
    _ratio("odometry_scale", 0.1, 0.3, "odometry's steps are too long", "odometry's steps are too short"),
    _ratio("depth_scale", 0.2, 0.5, "changes of depth are stated too large", "changes of depth are stated too small"),
    _delay("odometry_delay", "odometry is stamped too late", "odometry is stamped too early"),
    _delay("navigation_delay", "depth and attitude are stamped too late", "depth and attitude are stamped too early"),
    _delay("image_advance", "images are stamped too early", "images are stamped too late"),
)
NUMBER = {parameter.name: index for index, parameter in enumerate(PARAMETERS)}
"""Index of each parameter."""
