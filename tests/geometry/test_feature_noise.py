"""Feature noise: bins and beams in metres and radians, the least bearing sigma, and what follows from both."""

import numpy as np
import pytest

from asfm.config import NoiseConfig
from asfm.geometry.feature_noise import (
    difference_sigma,
    feature_sigma,
    gate_sigma,
    observation_sigma,
    relative_position_noise_m,
)
from asfm.geometry.sonar import SonarModel
from asfm.types import Tracks

NOISE = NoiseConfig(range_bins=1.5, bearing_beams=2.0, min_bearing_deg=0.3)


def make_sonar(beams: int) -> SonarModel:
    """Make a sonar with bins of 2 cm and beams over one radian."""
    return SonarModel.evenly_spaced("test", (0.0, 10.0), (-0.5, 0.5), (500, beams), 0.3)


@pytest.mark.parametrize(("beams", "bearing_rad"), [(100, 0.02), (1000, np.deg2rad(0.3))])
def test_bearings_are_no_better_than_the_least_sigma_however_fine_the_beams(beams: int, bearing_rad: float) -> None:
    np.testing.assert_allclose(feature_sigma(make_sonar(beams), NOISE), [0.03, bearing_rad])


def test_errors_of_both_ends_add_in_quadrature() -> None:
    """Two sigmas of the difference of two independent features, along the range and across it."""
    rng, sigma = np.random.default_rng(0), feature_sigma(make_sonar(100), NOISE)
    difference = rng.normal(0, sigma, (200_000, 2)) - rng.normal(0, sigma, (200_000, 2))
    np.testing.assert_allclose(difference_sigma(make_sonar(100), NOISE), difference.std(axis=0), rtol=0.01)
    moved_m = np.sqrt(np.mean(difference[:, 0] ** 2 + (5.0 * difference[:, 1]) ** 2))
    (found_m,) = relative_position_noise_m(np.array([5.0]), make_sonar(100), NOISE)
    assert found_m == pytest.approx(2 * moved_m, rel=0.01)


def test_stated_sigmas_come_first_and_gates_are_at_least_the_default() -> None:
    sonar, stated = make_sonar(100), np.array([[0.01, 0.5], [0.9, 0.001]])
    nothing = Tracks(np.arange(2), np.zeros(2, np.int64), np.ones(2), np.zeros(2))
    known = Tracks(np.arange(2), np.zeros(2, np.int64), np.ones(2), np.zeros(2), sigma=stated)
    np.testing.assert_allclose(observation_sigma(nothing, sonar, NOISE), [[0.03, 0.02]] * 2)
    np.testing.assert_array_equal(observation_sigma(known, sonar, NOISE), stated)
    np.testing.assert_allclose(gate_sigma(known, sonar, NOISE), [[0.03, 0.5], [0.9, 0.02]])


def test_shared_sigmas_cannot_be_changed_by_accident() -> None:
    for values in (feature_sigma(make_sonar(100), NOISE), difference_sigma(make_sonar(100), NOISE)):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0
