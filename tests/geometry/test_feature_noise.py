"""Feature noise: pixels in metres and radians, and sigmas of tracks that state them or do not."""

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
from asfm.types import FloatArray, Tracks

SONAR = SonarModel.evenly_spaced("made up", (1.0, 5.0), (-0.4, 0.4), (400, 80), 0.2)
"""Rows of 0.01 m and beams of 0.01 rad."""
NOISE = NoiseConfig(range_bins=2.0, bearing_beams=3.0, min_bearing_deg=0.1)
SIGMA = np.array([0.02, 0.03])


def _tracks(sigma: FloatArray | None) -> Tracks:
    return Tracks(np.zeros(3, np.int64), np.arange(3), np.full(3, 2.0), np.zeros(3), sigma)


def test_sigma_is_the_configured_number_of_pixels() -> None:
    np.testing.assert_allclose(feature_sigma(SONAR, NOISE), SIGMA, rtol=1e-9)
    fine = NoiseConfig(range_bins=2.0, bearing_beams=3.0, min_bearing_deg=5.0)
    assert feature_sigma(SONAR, fine)[1] == pytest.approx(np.radians(5.0))


def test_cached_sigmas_cannot_be_modified() -> None:
    for sigma in (feature_sigma(SONAR, NOISE), difference_sigma(SONAR, NOISE)):
        with pytest.raises(ValueError, match="read-only"):
            sigma[0] = 1.0


def test_noise_of_two_features_is_that_of_sampled_differences() -> None:
    rng = np.random.default_rng(0)
    difference = np.diff(rng.normal(scale=SIGMA, size=(2, 50_000, 2)), axis=0)[0]
    np.testing.assert_allclose(difference_sigma(SONAR, NOISE), difference.std(axis=0), rtol=0.02)
    range_m = np.array([1.0, 3.0])
    moved_m = np.sqrt(np.mean(difference[:, :1] ** 2 + (range_m * difference[:, 1:]) ** 2, axis=0))
    np.testing.assert_allclose(relative_position_noise_m(range_m, SONAR, NOISE), 2 * moved_m, rtol=0.02)


def test_tracks_have_the_sigmas_that_they_state_or_the_default_ones() -> None:
    stated = np.array([[0.01, 0.5], [0.5, 0.01], [0.02, 0.03]])
    np.testing.assert_array_equal(observation_sigma(_tracks(stated), SONAR, NOISE), stated)
    np.testing.assert_allclose(observation_sigma(_tracks(None), SONAR, NOISE), [SIGMA] * 3)
    np.testing.assert_allclose(gate_sigma(_tracks(stated), SONAR, NOISE), [[0.02, 0.5], [0.5, 0.03], [0.02, 0.03]])
