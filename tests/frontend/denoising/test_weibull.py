"""Weibull clutter: the shape recovered from images of known noise, and the transformation to exponential noise."""

import warnings

import numpy as np
import pytest

from asfm.config import CfarConfig
from asfm.frontend.denoising.cfar import detect_cfar
from asfm.frontend.denoising.weibull import (
    RAYLEIGH_SHAPE,
    SHAPE_LIMITS,
    _squared_tile_contrast,
    estimate_weibull_shape,
    transform_to_exponential,
)
from asfm.types import BoolArray, ImageArray

SHAPE = (512, 256)


def full(image: ImageArray) -> BoolArray:
    return np.ones(image.shape, dtype=bool)


def make_noise(shape: float, seed: int = 0) -> ImageArray:
    return np.random.default_rng(seed).weibull(shape, SHAPE).astype(np.float32)


@pytest.mark.parametrize("shape", [1.0, 1.5, 2.0, 3.0, 4.0])
@pytest.mark.parametrize("gain", [1.0, 1e-4, 6e4])
def test_the_shape_is_recovered(shape: float, gain: float) -> None:
    image = np.float32(gain) * make_noise(shape)
    assert estimate_weibull_shape(image, full(image)) == pytest.approx(shape, rel=0.015)


@pytest.mark.parametrize("shape", [1.0, 2.0, 4.0])
def test_the_estimate_is_robust_against_the_scene(shape: float) -> None:
    """A level that falls with range, echoes in a third of the image, a shadow and dead beams."""
    image = make_noise(shape) * np.linspace(3, 1, SHAPE[0], dtype=np.float32)[:, None]
    rng = np.random.default_rng(1)
    for row, column in rng.integers((0, 0), SHAPE, (150, 2)):
        image[row : row + 12, column : column + 24] *= np.float32(rng.uniform(2, 20))
    image[100:180, 60:110] *= 0.05
    valid = full(image)
    valid[:, 200:203] = False
    image[:, 200:203] = 0
    assert estimate_weibull_shape(image, valid) == pytest.approx(shape, rel=0.05)


@pytest.mark.parametrize("shape", [1.0, 2.0, 3.3])
def test_transformed_noise_is_exponential(shape: float) -> None:
    image = make_noise(shape)
    usable = full(image)
    usable[:, :20] = False
    image[:, :20] = np.float32(1e6)
    power = transform_to_exponential(image, usable)
    assert not power[:, :20].any()
    mean = power[usable].mean()
    for level in (0.5, 1.0, 3.0):
        assert (power[usable] > level * mean).mean() == pytest.approx(np.exp(-level), rel=0.03)


@pytest.mark.parametrize("usable_share", [0.3, 1.0])
def test_the_contrast_of_tiles_has_no_bias_from_few_pixels(usable_share: float) -> None:
    """Tiles of 16 x 16 pixels of which some are usable, against the contrast of the Rayleigh distribution."""
    rng = np.random.default_rng(6)
    image = rng.rayleigh(1.0, (1600, 1600)).astype(np.float32)
    usable = rng.random(image.shape) < usable_share
    found = _squared_tile_contrast(np.where(usable, image, np.float32(0)), usable)
    assert found.mean() == pytest.approx(4 / np.pi - 1, rel=0.006)


@pytest.mark.parametrize("sigma", [4, 8, 40])
def test_the_shape_is_recovered_from_few_grey_levels(sigma: float) -> None:
    image = np.round(np.random.default_rng(3).rayleigh(sigma, SHAPE)).astype(np.float32)
    assert estimate_weibull_shape(image, np.asarray(image > 0)) == pytest.approx(2.0, rel=0.06)


@pytest.mark.parametrize("cut", [0.5, 1.0, 2.0])
def test_censored_noise_has_the_configured_false_alarm_rate(cut: float) -> None:
    """Rayleigh noise above a threshold is nearly, not exactly, Weibull distributed."""
    image = np.maximum(np.random.default_rng(4).rayleigh(1.0, SHAPE) - cut, 0).astype(np.float32)
    for probability in (0.1, 0.05, 0.01):
        config = CfarConfig(false_alarm_probability=probability, noise="weibull")
        assert detect_cfar(image, full(image), config).mean() == pytest.approx(probability, rel=0.35)


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (17, 15), (64, 64), (512, 3)])
@pytest.mark.parametrize("value", [0.0, 0.5, 255.0, 65535.0, np.nan, -3.0])
def test_uniform_images_have_the_default_shape_and_no_detections(shape: tuple[int, int], value: float) -> None:
    image = np.full(shape, value, dtype=np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not detect_cfar(image, full(image), CfarConfig(noise="weibull")).any()
        if np.isfinite(value):
            positive = np.maximum(image, 0)
            assert estimate_weibull_shape(positive, full(image)) == RAYLEIGH_SHAPE
            assert np.isfinite(transform_to_exponential(positive, full(image))).all()
            assert not transform_to_exponential(image, ~full(image)).any()


def test_extreme_images_give_finite_results_within_the_limits() -> None:
    """Echoes six decades above the noise, half of the image saturated, 16 bits, hardly any contrast."""
    bright = make_noise(4.0)
    bright[100:110, 100:110] = 1e6
    assert np.isfinite(transform_to_exponential(bright, full(bright))).all()
    found = detect_cfar(bright, full(bright), CfarConfig(noise="weibull", false_alarm_probability=1e-3))
    assert found[100:110, 100:110].all() and found.mean() < 0.01
    saturated = make_noise(2.0)
    saturated[:256] = 50
    assert estimate_weibull_shape(saturated, full(saturated)) == pytest.approx(2.0, rel=0.05)
    counts = np.round(2000 * make_noise(2.0)).astype(np.uint16)
    expected = detect_cfar(counts.astype(np.float32), full(saturated), CfarConfig(noise="weibull"))
    np.testing.assert_array_equal(detect_cfar(counts, full(saturated), CfarConfig(noise="weibull")), expected)
    faint = 1 + 1e-3 * make_noise(2.0)
    assert SHAPE_LIMITS[0] <= estimate_weibull_shape(faint, full(faint)) <= SHAPE_LIMITS[1]
