"""Residual gate: sigmas at least the default ones, wider without odometry, and a blurred edge of the aperture."""

import numpy as np
import pytest

from asfm.backend.estimation.residual_gate import GUESSED_SLACK, MEASURED_SLACK, make_residual_gate
from asfm.backend.graph.aperture_bounds import EDGE_RAD
from asfm.config import Config
from asfm.geometry.feature_noise import feature_sigma
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.types import FloatArray, Tracks
from tests.worlds import VEHICLE_SONAR, make_constraints, make_vehicle_sequence

SEQUENCE = make_vehicle_sequence()
DEFAULT = feature_sigma(VEHICLE_SONAR, Config().noise)


def constrain(rotation_rad: float, measured: bool = True) -> SensorConstraints:
    count = len(SEQUENCE)
    sigma = np.tile([rotation_rad, 0.02], (count - 1, 1))
    return make_constraints(SEQUENCE, np.tile(np.eye(4), (count, 1, 1)), sigma, measured)


def make_tracks(sigma: FloatArray | None = None) -> Tracks:
    return Tracks(np.zeros(3, int), np.arange(3), np.full(3, 5.0), np.zeros(3), sigma=sigma)


@pytest.mark.parametrize(("measured", "slack"), [(True, MEASURED_SLACK), (False, GUESSED_SLACK)])
def test_tracks_without_sigmas_get_the_default_ones_with_slack(measured: bool, slack: float) -> None:
    found = make_residual_gate(make_tracks(), SEQUENCE, constrain(0.005, measured), Config())
    np.testing.assert_allclose(found.sigma, np.tile(slack * DEFAULT, (3, 1)))
    assert GUESSED_SLACK > MEASURED_SLACK > 1


def test_stated_sigmas_are_used_where_they_are_larger_than_the_default() -> None:
    stated = np.array([[3.0, 0.1], [0.1, 4.0], [1.0, 1.0]]) * DEFAULT
    found = make_residual_gate(make_tracks(stated), SEQUENCE, constrain(0.005), Config())
    np.testing.assert_allclose(found.sigma, MEASURED_SLACK * np.array([[3.0, 1.0], [1.0, 4.0], [1.0, 1.0]]) * DEFAULT)


@pytest.mark.parametrize("rotation_rad", [0.0, 0.005, 0.2])
def test_edge_of_the_aperture_is_blurred_by_the_rotation_error_of_a_step(rotation_rad: float) -> None:
    gate = make_residual_gate(make_tracks(), SEQUENCE, constrain(rotation_rad), Config()).gate
    assert gate.half_aperture_rad == VEHICLE_SONAR.elevation_aperture_rad / 2
    assert gate.edge_rad == pytest.approx(np.sqrt(EDGE_RAD**2 + rotation_rad**2))
