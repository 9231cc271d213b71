"""Observability: directions constrained by the steps alone, and positions too uncertain for their path."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.backend.diagnostics.observability import (
    find_unobserved_directions,
    warn_of_position_uncertainty,
    warn_of_unobserved_directions,
)
from asfm.backend.graph.marginal_covariance import Uncertainty
from asfm.geometry.sonar import SonarModel
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.sequence import Sequence
from asfm.types import BoolArray
from tests.worlds import make_constraints, no_frame

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (500, 128), np.deg2rad(20))
FRAMES, SPAN = 40, 5
ROTATION_RAD, TRANSLATION_M = 0.01, 0.02


@pytest.fixture
def sensors() -> SensorConstraints:
    poses = np.repeat(np.eye(4)[None], FRAMES, axis=0)
    poses[:, 0, 3] = 0.1 * np.arange(FRAMES)
    sequence = Sequence("made up", SONAR, np.arange(FRAMES, dtype=float), no_frame)
    steps = np.tile([ROTATION_RAD, TRANSLATION_M], (FRAMES - 1, 1))
    return make_constraints(sequence, poses, steps, measured=True)


def make_uncertainty(unobserved: BoolArray) -> Uncertainty:
    """Make spans with the sigma of the steps alone where unobserved, (N - S, 6), and a third of it elsewhere."""
    sigma = np.sqrt(SPAN) * np.repeat([ROTATION_RAD, TRANSLATION_M], 3) * np.where(unobserved, 0.99, 0.3)
    covariance = sigma[:, :, None] * np.eye(6) * sigma[:, None]
    return Uncertainty(np.zeros((FRAMES, 6, 6)), covariance, np.zeros((0, 3, 3)))


def test_unobserved_directions_are_reported_with_their_frames(sensors: SensorConstraints) -> None:
    unobserved = np.zeros((FRAMES - SPAN, 6), dtype=bool)
    unobserved[10:21, [1, 5]] = True
    unobserved[:, 0] = True
    found = find_unobserved_directions(make_uncertainty(unobserved), sensors)
    assert found[:, 0].all() and not found[:, 2:5].any()
    np.testing.assert_array_equal(np.flatnonzero(found[:, 5]), np.arange(10, 26))
    diagnostics = warn_of_unobserved_directions(make_uncertainty(unobserved), sensors)
    assert [diagnostic.code for diagnostic in diagnostics] == ["unobserved-directions"] * 2
    assert [diagnostic.frames for diagnostic in diagnostics] == [((0, 39),), ((10, 25),)]
    assert [diagnostic.message for diagnostic in diagnostics] == [
        "roll is held by the odometry alone in frames 0-39",
        "pitch and height are held by the odometry alone in frames 10-25",
    ]
    guessed = warn_of_unobserved_directions(make_uncertainty(unobserved), replace(sensors, measured=False))
    assert guessed[0].message == "roll is held by the assumption that the vehicle moves little alone in frames 0-39"


def test_no_diagnostic_where_everything_is_observed(sensors: SensorConstraints) -> None:
    assert warn_of_unobserved_directions(make_uncertainty(np.zeros((FRAMES - SPAN, 6), dtype=bool)), sensors) == ()


def test_positions_are_reported_from_a_sigma_of_a_tenth_of_the_path() -> None:
    poses = np.repeat(np.eye(4)[None], FRAMES, axis=0)
    poses[:, 0, 3] = np.linspace(0, 4.0, FRAMES)
    growing = np.zeros((FRAMES, 6, 6))
    growing[:, 3, 3] = (0.02 * np.arange(FRAMES)) ** 2
    (found,) = warn_of_position_uncertainty(Uncertainty(growing, growing[:1], growing[:, :3, :3]), poses, 5.0)
    assert found.code == "position-uncertainty" and found.frames == ((21, FRAMES - 1),)
    assert "from frame 21 on" in found.message and "0.78 m at the end" in found.message
    certain = Uncertainty(growing / 16, growing[:1], growing[:, :3, :3])
    assert warn_of_position_uncertainty(certain, poses, 5.0) == ()


def test_a_sonar_at_rest_is_compared_with_its_range() -> None:
    still = np.repeat(np.eye(4)[None], FRAMES, axis=0)
    covariance = np.tile(np.diag([0, 0, 0, 0.01, 0.01, 0.01]) ** 2, (FRAMES, 1, 1))
    assert warn_of_position_uncertainty(Uncertainty(covariance, covariance, covariance[:, :3, :3]), still, 5.0) == ()
    assert (
        warn_of_position_uncertainty(Uncertainty(49 * covariance, covariance, covariance[:, :3, :3]), still, 5.0) != ()
    )
