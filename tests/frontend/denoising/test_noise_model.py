"""Noise model: floor, variance, correlation and contrast recovered from images of known noise."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from asfm.frontend.denoising.noise_model import (
    BANDS,
    BLANKED_BANDS,
    ECHO_SIGMA_PX,
    estimate_floor,
    estimate_noise,
    smooth_echoes,
)
from asfm.types import FloatArray, ImageArray

SHAPE = (300, 160)
VALID = np.ones(SHAPE, dtype=bool)
CONTRAST = 0.35
RAYLEIGH_MEAN = np.sqrt(np.pi / 2)


def draw_speckle(rng: np.random.Generator, shape: tuple[int, ...] = SHAPE) -> FloatArray:
    """Draw Weibull speckle of mean 1 and contrast 0.35, that of the simulated sonars."""
    return np.asarray(rng.weibull(1 / 0.3235, shape) / 0.8956)


def draw_scene() -> ImageArray:
    """Draw a wide echo and a small bright one without noise."""
    clean = np.zeros(SHAPE, dtype=np.float32)
    clean[120:240, 10:100] = 0.25
    clean[60:70, 110:130] = 0.7
    return clean


def add_noise(clean: ImageArray, seed: int, sigma: FloatArray | float = 0.04) -> ImageArray:
    """Multiply by speckle and add Rayleigh noise."""
    rng = np.random.default_rng(seed)
    return np.clip(clean * draw_speckle(rng) + rng.rayleigh(1, SHAPE) * sigma, 0, 1).astype(np.float32)


def test_the_speckle_of_these_tests_has_its_mean_and_contrast() -> None:
    speckle = draw_speckle(np.random.default_rng(0), (1000, 1000))
    assert speckle.mean() == pytest.approx(1, abs=0.01) and speckle.std() == pytest.approx(CONTRAST, abs=0.01)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("growth", [0.0, 0.8])
def test_the_floor_is_estimated_under_wide_echoes(seed: int, growth: float) -> None:
    """Echoes over all beams fill 70 rows, which show no background at all."""
    sigma = 0.05 * ((np.arange(300)[:, None] + 60) / 360) ** growth
    clean = draw_scene()
    clean[130:200] = 0.3
    floor = estimate_floor(add_noise(clean, seed, sigma), VALID)
    assert floor.shape == (300, 1)
    true = RAYLEIGH_MEAN * sigma * np.ones_like(floor)
    visible = np.ones(300, dtype=bool)
    visible[115:215] = False
    np.testing.assert_allclose(floor[visible], true[visible], rtol=0.2)
    np.testing.assert_allclose(floor[~visible], true[~visible], rtol=0.5)  # the echo is eight times the floor


@pytest.mark.parametrize("seed", range(3))
def test_all_parameters_are_estimated_and_zero_without_noise(seed: int) -> None:
    noise = estimate_noise(add_noise(draw_scene(), seed), VALID)
    assert noise.contrast == pytest.approx(CONTRAST, abs=0.08)
    assert noise.beam_correlation == pytest.approx(0, abs=0.05)
    np.testing.assert_allclose(noise.background_variance, (2 - np.pi / 2) * 0.04**2, rtol=0.35)
    none = estimate_noise(draw_scene(), VALID)
    assert none.contrast == 0 and not none.floor.any() and not none.background_variance.any()


def test_correlation_between_beams_is_estimated() -> None:
    rng = np.random.default_rng(4)
    parts = rng.normal(size=(2, 300, 162))
    real, imaginary = (parts[..., :-2] + 2 * parts[..., 1:-1] + parts[..., 2:]) / np.sqrt(6)
    image = (0.04 * np.hypot(real, imaginary)).astype(np.float32)
    assert estimate_noise(image, VALID).beam_correlation == pytest.approx(4 / 9, abs=0.12)  # (2 / 3)^2, of energies


@pytest.mark.parametrize("gain", [2.0**-10, 2.0**8])
def test_floor_and_variance_scale_with_the_gain(gain: float) -> None:
    image = add_noise(np.zeros(SHAPE, dtype=np.float32), 1)
    noise, scaled = estimate_noise(image, VALID), estimate_noise(image * np.float32(gain), VALID)
    assert noise.floor.min() > 0
    np.testing.assert_allclose(scaled.floor, gain * noise.floor, rtol=1e-5)
    np.testing.assert_allclose(scaled.background_variance, gain**2 * noise.background_variance, rtol=1e-4)
    assert scaled.beam_correlation == pytest.approx(noise.beam_correlation, abs=1e-4)


def test_invalid_pixels_do_not_change_the_floor() -> None:
    image, valid = add_noise(draw_scene(), 2), VALID.copy()
    valid[20:60, 30:60] = valid[250:, 100:120] = False
    floors = [estimate_floor(np.where(valid, image, np.float32(fill)), valid) for fill in (0.0, 0.04, 1.0)]
    assert floors[0].min() > 0
    np.testing.assert_allclose(floors[1:], [floors[0], floors[0]], rtol=1e-4)
    nothing = estimate_noise(image, ~VALID)
    assert not nothing.floor.any() and not nothing.background_variance.any() and nothing.contrast == 0


@pytest.mark.parametrize("seed", range(3))
def test_the_floor_grows_at_most_with_the_square_of_range(seed: int) -> None:
    """Far rows full of strong noise-like echoes would raise the floor tenfold."""
    sigma = np.where(np.arange(300)[:, None] < 150, 0.01, 0.1)
    floor = estimate_floor(add_noise(np.zeros(SHAPE, dtype=np.float32), seed, sigma), VALID)[:, 0].astype(float)
    per_square = floor / (np.arange(300) + 0.5) ** 2
    beyond = per_square[(BLANKED_BANDS + 2) * 300 // BANDS :]
    assert floor[-1] < 0.75 * RAYLEIGH_MEAN * 0.1
    assert (beyond <= 1.1 * np.minimum.accumulate(beyond)).all()


def test_smoothing_is_a_gaussian_filter() -> None:
    image = np.random.default_rng(3).random(SHAPE).astype(np.float32)
    expected = gaussian_filter(image, ECHO_SIGMA_PX, mode="mirror", truncate=4)
    np.testing.assert_allclose(smooth_echoes(image), expected, atol=0.01)


def test_rows_that_the_sonar_blanks_do_not_bound_the_floor() -> None:
    """The nearest rows hold next to nothing, from which noise could not grow to that of the others."""
    sigma = np.where(np.arange(300)[:, None] < (BLANKED_BANDS - 0.5) * 300 / BANDS, 1e-6, 0.04)
    floor = estimate_floor(add_noise(np.zeros(SHAPE, dtype=np.float32), 1, sigma), VALID)
    np.testing.assert_allclose(floor[40:], RAYLEIGH_MEAN * 0.04, rtol=0.15)


def test_texture_without_speckle_has_no_contrast() -> None:
    """Waves of a quarter of the mean, twelve rows long."""
    waves = np.repeat(0.4 + 0.1 * np.sin(np.arange(300)[:, None] / 2), 160, axis=1).astype(np.float32)
    assert estimate_noise(waves, VALID).contrast == 0
