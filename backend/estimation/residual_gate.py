"""What the misfit of an observation is measured with when points are triangulated."""

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
"""Sigmas are widened by this for triangulation, because the poses are not yet right: measured and guessed motion."""


@dataclass(frozen=True)
class ResidualGate:
    """The same for all solutions that are compared."""

    sigma: FloatArray
    """(O, 2) of range_m and bearing_rad, the slack included."""
    gate: Gate


def make_residual_gate(tracks: Tracks, sequence: Sequence, sensors: SensorConstraints, config: Config) -> ResidualGate:
    """Take the observations' sigmas, at least the typical ones, and a gate around the beam's edge."""
    sigma = gate_sigma(tracks, sequence.sonar, config.noise)
    edge_rad = float(np.hypot(EDGE_RAD, sensors.typical_rotation_rad))
    slack = MEASURED_SLACK if sensors.measured else GUESSED_SLACK
    return ResidualGate(sigma * slack, Gate(sequence.sonar.elevation_aperture_rad / 2, edge_rad))
