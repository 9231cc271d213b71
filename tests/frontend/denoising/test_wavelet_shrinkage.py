"""Wavelet shrinkage: exact decomposition, noise gains against noise, and Wiener filter properties."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import convolve1d

from asfm.frontend.denoising.noise_model import ImageNoise
from asfm.frontend.denoising.wavelet_shrinkage import (
    LEVELS,
    SPLINE,
    _band_noise_gains,
    _decompose,
    _filter_variance,
    _noise_variance,
    _shrink_bands,
    shrink_noise,
)
from asfm.types import FloatArray, ImageArray

SHAPE = (200, 150)


def noise_of(floor: float = 0.0, variance: float = 0.0, contrast: float = 0.0, rows: int = SHAPE[0]) -> ImageNoise:
    floors, variances = (np.full((rows, 1), value, dtype=np.float32) for value in (floor, variance))
    return ImageNoise(floors, variances, 0.0, contrast)


def draw_steps() -> ImageArray:
    clean = np.full(SHAPE, 0.2, dtype=np.float32)
    clean[60:140, 30:110] = 0.6
    return clean


@settings(deadline=None, max_examples=30)
@given(shape=st.tuples(st.integers(1, 40), st.integers(1, 40)), level=st.integers(0, LEVELS - 1))
def test_bands_are_those_of_scipy_and_sum_to_the_image(shape: tuple[int, int], level: int) -> None:
    image = np.random.default_rng(0).random(shape).astype(np.float32)
    details, approximation = _decompose(image, level)
    np.testing.assert_allclose(sum(details) + approximation, image, atol=1e-5)
    taps = np.zeros(4 * 2**level + 1)
    taps[:: 2**level] = SPLINE
    low = [convolve1d(image.astype(float), taps, axis=axis, mode="mirror") for axis in (0, 1)]
    both = convolve1d(low[0], taps, axis=1, mode="mirror")
    np.testing.assert_allclose(approximation, both, atol=1e-5)
    for band, expected in zip(details, (image - low[0] - low[1] + both, low[0] - both, low[1] - both), strict=True):
        np.testing.assert_allclose(band, expected, atol=1e-5)


@pytest.mark.parametrize("correlated", [False, True])
def test_noise_gains_are_the_variances_of_filtered_noise(correlated: bool) -> None:
    noise = np.random.default_rng(1).normal(size=(1500, 1500)).astype(np.float32)
    correlation = 0.0
    if correlated:
        kernel = np.exp(-(np.arange(-8, 9) ** 2) / (2 * 1.2**2))
        noise = np.apply_along_axis(np.convolve, 1, noise, kernel / np.linalg.norm(kernel), "same").astype(np.float32)
        correlation = float(np.exp(-1 / (4 * 1.2**2)))
    gains, rest = _band_noise_gains(correlation), noise
    for level in range(len(gains)):
        bands, smooth = _decompose(rest, level)
        np.testing.assert_allclose(sum(bands) + smooth, rest, atol=1e-5)
        measured = [float(band[20:-20, 20:-20].var()) for band in bands]
        np.testing.assert_allclose(gains[level], measured, rtol=0.05, atol=1e-4)
        rest = smooth


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.95])
def test_filter_variance_is_a_quadratic_form(correlation: float) -> None:
    kernel: FloatArray = np.array([0.2, -0.5, 1.0, 0.3])
    lag = np.subtract.outer(np.arange(4), np.arange(4)).astype(float)
    covariance = np.where(lag == 0, 1.0, correlation ** (lag**2))
    assert _filter_variance(kernel, correlation) == pytest.approx(float(kernel @ covariance @ kernel))


def test_an_image_without_noise_is_returned_as_a_copy() -> None:
    clean = draw_steps()
    result = shrink_noise(clean, clean, noise_of())
    np.testing.assert_array_equal(result, clean)
    assert not np.shares_memory(result, clean)


def test_negligible_noise_changes_nearly_nothing() -> None:
    clean = draw_steps()
    np.testing.assert_allclose(shrink_noise(clean, clean, noise_of(variance=1e-10)), clean, atol=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_background_fluctuation_is_reduced_and_its_mean_kept(seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = (0.3 + 0.05 * rng.normal(size=SHAPE)).astype(np.float32)
    result = shrink_noise(image, np.zeros_like(image), noise_of(0.3, 0.05**2))
    inner = slice(10, -10), slice(10, -10)
    assert result[inner].std() < 0.3 * image[inner].std()
    assert result[inner].mean() == pytest.approx(0.3, abs=0.002)


@pytest.mark.parametrize("seed", range(3))
def test_speckle_is_reduced_and_edges_are_kept(seed: int) -> None:
    rng, clean = np.random.default_rng(seed), draw_steps()
    image = (clean * (1 + 0.2 * rng.normal(size=SHAPE))).astype(np.float32)
    result = shrink_noise(image, clean, noise_of(contrast=0.2))
    before, after = (float(np.sqrt(np.mean((values - clean) ** 2))) for values in (image, result))
    assert after < 0.5 * before
    step = result[70:130, 31].mean() - result[70:130, 28].mean()
    assert step == pytest.approx(0.4, rel=0.15)


@pytest.mark.parametrize("seed", range(3))
def test_the_second_pass_reduces_the_error_of_the_first(seed: int) -> None:
    """The second pass takes the signal energy from the pilot, over a smaller window."""
    rng, clean = np.random.default_rng(seed), draw_steps()
    image = (clean + 0.1 * rng.normal(size=SHAPE)).astype(np.float32)
    variance = np.full(SHAPE, 0.1**2, dtype=np.float32)
    pilot = _shrink_bands(image, None, variance, _band_noise_gains(0.0))
    result = shrink_noise(image, clean, noise_of(variance=0.1**2))
    errors = [float(np.sqrt(np.mean((values - clean) ** 2))) for values in (image, pilot, result)]
    assert errors[1] < 0.5 * errors[0]
    assert errors[2] < 0.9 * errors[1]


@pytest.mark.parametrize("gain", [2.0**-6, 2.0**10])
def test_the_result_scales_with_the_gain(gain: float) -> None:
    rng, clean = np.random.default_rng(5), draw_steps()
    image = (clean * (1 + 0.2 * rng.normal(size=SHAPE)) + 0.05).astype(np.float32)
    plain = shrink_noise(image, clean, noise_of(0.05, 1e-3, 0.2))
    scaled = shrink_noise(
        image * np.float32(gain), clean * np.float32(gain), noise_of(0.05 * gain, 1e-3 * gain**2, 0.2)
    )
    np.testing.assert_allclose(scaled, gain * plain, rtol=1e-3)


def test_the_image_is_not_modified() -> None:
    image = np.random.default_rng(6).random(SHAPE).astype(np.float32)
    before = image.copy()
    shrink_noise(image, image, noise_of(0.1, 0.01, 0.3))
    np.testing.assert_array_equal(image, before)


def test_pixels_darker_than_the_background_hold_no_speckle() -> None:
    echoes = np.tile(np.array([-0.2, 0.0, 0.3], dtype=np.float32), (4, 1))
    variance = _noise_variance(echoes, noise_of(variance=0.01, contrast=0.5, rows=4))
    np.testing.assert_allclose(variance, np.tile([0.01, 0.01, 0.01 + 0.15**2], (4, 1)), rtol=1e-6)
