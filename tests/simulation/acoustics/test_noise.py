"""Speckle, background noise and threshold: their statistics are those requested."""

import numpy as np
import pytest
from scipy import stats

from asfm.simulation.acoustics.correlated_fields import draw_mix, make_field_bank, mix_energies
from asfm.simulation.acoustics.noise import add_noise
from asfm.simulation.acoustics.receiver import make_point_spread
from asfm.simulation.sonars.parameters import ImagingSonar, make_sonar_model
from asfm.types import ImageArray

SONAR = ImagingSonar(range_bins=300, azimuth_bins=128, azimuth=60)
MODEL = make_sonar_model(SONAR)


def _noisy(level: float, **changes: object) -> ImageArray:
    sonar = SONAR.model_copy(update=changes)
    clean = np.full(MODEL.shape, level, dtype=np.float32)
    return add_noise(clean, sonar, MODEL, np.random.default_rng(3))


@pytest.mark.parametrize("sigma", [0.01, 0.08])
def test_background_is_rayleigh(sigma: float) -> None:
    background = _noisy(0.0, add_sigma=sigma).ravel()
    assert stats.kstest(background, stats.rayleigh(scale=sigma).cdf).pvalue > 0.01
    # The test is sensitive: a scale that is wrong by 3 % fails.
    assert stats.kstest(background, stats.rayleigh(scale=1.03 * sigma).cdf).pvalue < 0.01


@pytest.mark.parametrize("contrast", [0.1, 0.35, 0.52])
def test_speckle_has_the_requested_contrast_and_mean(contrast: float) -> None:
    image = _noisy(0.1, add_sigma=0.0, mult_sigma=contrast)
    assert image.std() / image.mean() == pytest.approx(contrast, rel=0.05)
    assert image.mean() == pytest.approx(0.1, rel=0.02)


def test_overlapping_beams_are_correlated_with_unchanged_statistics() -> None:
    """Beams of 0.8 degrees every 0.47: energies correlate as the lobes do, and every single beam is Rayleigh."""
    sonar = SONAR.model_copy(update={"beam_width_deg": 0.8, "add_sigma": 0.05, "mult_sigma": 0.35})
    bank = make_field_bank(make_point_spread(sonar, MODEL).lobe, np.random.default_rng(0))
    dark, grey = (np.full(MODEL.shape, level, dtype=np.float32) for level in (0.0, 0.1))
    background = add_noise(dark, sonar, MODEL, np.random.default_rng(1), bank)
    for beams in (slice(0, None, 9), slice(5, None, 9)):
        assert stats.kstest(background[:, beams].ravel(), stats.rayleigh(scale=0.05).cdf).pvalue > 0.01
    energy = background.astype(float) ** 2
    centred = energy - energy.mean()
    for away in (1, 2, 3, 8):
        found = (centred[:, away:] * centred[:, :-away]).mean() / centred.var()
        # Gaussian lobes of power width w: the field's correlation is exp(-ln 2 (d / w)^2), the energy's its square.
        expected = np.exp(-2 * np.log(2) * (away * np.rad2deg(MODEL.bearing_step_rad) / 0.8) ** 2)
        assert found == pytest.approx(expected, abs=0.06)
    assert abs((centred[1:] * centred[:-1]).mean() / centred.var()) < 0.03
    speckled = add_noise(grey, sonar.model_copy(update={"add_sigma": 0.0}), MODEL, np.random.default_rng(1), bank)
    assert speckled.std() / speckled.mean() == pytest.approx(0.35, rel=0.05)
    speckle, noise = (
        energies.ravel() for energies in mix_energies(bank, draw_mix(bank, 300, np.random.default_rng(3)))
    )
    assert abs(np.corrcoef(speckle, noise)[0, 1]) < 0.02
    again = add_noise(dark, sonar, MODEL, np.random.default_rng(2), bank)
    assert abs(np.corrcoef(background.ravel(), again.ravel())[0, 1]) < 0.02


def test_noisy_image_is_in_range_and_zero_noise_changes_nothing() -> None:
    loud = _noisy(0.9, add_sigma=0.5, mult_sigma=0.8)
    assert loud.dtype == np.float32 and loud.min() >= 0 and loud.max() <= 1
    assert np.array_equal(_noisy(0.4, add_sigma=0.0, mult_sigma=0.0), np.full(MODEL.shape, 0.4, dtype=np.float32))


def test_background_grows_with_the_requested_power_of_range() -> None:
    image = _noisy(0.0, add_sigma=0.05, noise_range_exponent=1.0)
    by_row = image.mean(axis=1)
    expected = 0.05 * np.sqrt(np.pi / 2) * MODEL.range_m / SONAR.range_max
    assert np.polyfit(expected, by_row, 1)[0] == pytest.approx(1.0, abs=0.05)
