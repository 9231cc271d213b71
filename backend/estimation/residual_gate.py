"""Residual scale and gate used in triangulation."""

from dataclasses import dataclass

import numpy as np

from asfm.backend.estimation.triangulation import Gate
from asfm.backend.graph.aperture_bounds import EDGE_RAD
from asfm.config import Config
from asfm.geometry.feature_noise import gate_sigma
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.sequence import Sequence
from asfm.types import FloatArray, Tracks

MEASURED_SLACK, GUESSED_SLACK = 1.2, 1.5
"""Factors of the sigmas in triangulation, which cover pose errors: with odometry, and with a motion prior only."""


@dataclass(frozen=True)
class ResidualGate:
    """Sigmas and gate of the residuals; solutions are comparable only under the same one."""

    sigma: FloatArray
    """(O, 2) standard deviations of range_m and bearing_rad, including the slack."""
    gate: Gate


def make_residual_gate(tracks: Tracks, sequence: Sequence, sensors: SensorConstraints, config: Config) -> ResidualGate:
    """Make the sigmas and the gate with which tracks are triangulated.

    The sigmas are those stated, but at least the default ones, times a factor for pose errors. The edge of the
    elevation aperture is blurred by the typical rotation error of a step.

    Args:
        tracks: (O,) observations.
        sequence: gives the sonar.
        sensors: typical rotation error, and whether the motion is measured.
        config: section ``noise``.
    """
    sigma = gate_sigma(tracks, sequence.sonar, config.noise)
    edge_rad = float(np.hypot(EDGE_RAD, sensors.typical_rotation_rad))
    slack = MEASURED_SLACK if sensors.measured else GUESSED_SLACK
    return ResidualGate(sigma * slack, Gate(sequence.sonar.elevation_aperture_rad / 2, edge_rad))
