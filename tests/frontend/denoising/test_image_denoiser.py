"""The clean image: noise estimated from the image alone, echoes kept, speckle calmed, nothing invented."""

import numpy as np
import pytest

from asfm.config import Config
from asfm.evaluation.denoising.metrics import measure_psnr
from asfm.frontend.denoising.image_denoiser import _correct_saturation, denoise_image, mask_image
from asfm.frontend.denoising.noise_model import estimate_floor, estimate_noise
from asfm.frontend.denoising.wavelet_shrinkage import _band_noise_gains, _decompose, shrink_noise
from asfm.types import BoolArray, FloatArray, Frame, ImageArray

SHAPE = (300, 160)
VALID = np.ones(SHAPE, dtype=bool)
CONTRAST = 0.35


def draw_weibull(rng: np.random.Generator, shape: tuple[int, ...] = SHAPE) -> FloatArray:
    """Speckle of mean 1 and the contrast that the simulator's sonars have."""
    speckle = rng.weibull(1 / 0.3235, shape)
    return np.asarray(speckle / 0.8956)


def draw_scene() -> ImageArray:
    """A wide echo, to starboard, and a small bright one to port, without noise."""
    clean = np.zeros(SHAPE, dtype=np.float32)
    clean[120:240, 10:100] = 0.25
    clean[60:70, 110:130] = 0.7
    return clean


def spoil(clean: ImageArray, seed: int, floor_sigma: FloatArray | float = 0.04) -> ImageArray:
    rng = np.random.default_rng(seed)
    return np.clip(clean * draw_weibull(rng) + rng.rayleigh(1, SHAPE) * floor_sigma, 0, 1).astype(np.float32)


def clean_up(image: ImageArray, invalid: BoolArray | None = None, span: float | None = None) -> ImageArray:
    invalid = np.zeros(image.shape, dtype=bool) if invalid is None else invalid
    return denoise_image(Frame(0, 0.0, image, invalid, span), Config())


def test_the_speckle_of_these_tests_is_what_it_says() -> None:
    speckle = draw_weibull(np.random.default_rng(0), (1000, 1000))
    assert speckle.mean() == pytest.approx(1, abs=0.01) and speckle.std() == pytest.approx(CONTRAST, abs=0.01)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("growth", [0.0, 0.8])
def test_the_floor_is_found_under_echoes_that_fill_half_the_rows(seed: int, growth: float) -> None:
    sigma = 0.05 * ((np.arange(300)[:, None] + 60) / 360) ** growth
    clean = draw_scene()
    clean[130:200] = 0.3  # over all beams: these rows show no water at all
    floor = estimate_floor(spoil(clean, seed, sigma), VALID)
    assert floor.shape == (300, 1)
    true = np.sqrt(np.pi / 2) * sigma * np.ones_like(floor)
    seen = np.ones(300, dtype=bool)
    seen[115:215] = False
    np.testing.assert_allclose(floor[seen], true[seen], rtol=0.2)
    np.testing.assert_allclose(floor[~seen], true[~seen], rtol=0.5)  # the echo is eight times the floor


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_measured_and_an_image_without_any_has_none(seed: int) -> None:
    noise = estimate_noise(spoil(draw_scene(), seed), VALID)
    assert noise.contrast == pytest.approx(CONTRAST, abs=0.08)
    assert noise.beam_correlation == pytest.approx(0, abs=0.05)
    np.testing.assert_allclose(noise.background_variance, (2 - np.pi / 2) * 0.04**2, rtol=0.35)
    none = estimate_noise(draw_scene(), VALID)
    assert none.contrast == 0 and not none.floor.any() and not none.background_variance.any()


def test_beams_that_hear_alike_are_recognised() -> None:
    rng = np.random.default_rng(4)
    parts = rng.normal(size=(2, 300, 162))
    real, imaginary = (parts[..., :-2] + 2 * parts[..., 1:-1] + parts[..., 2:]) / np.sqrt(6)
    image = (0.04 * np.hypot(real, imaginary)).astype(np.float32)
    assert estimate_noise(image, VALID).beam_correlation == pytest.approx(4 / 9, abs=0.12)  # (2 / 3)², of energies


@pytest.mark.parametrize("correlated", [False, True])
def test_the_share_of_noise_in_each_band_is_that_of_noise(correlated: bool) -> None:
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


def test_saturation_is_undone_on_average() -> None:
    speckle = draw_weibull(np.random.default_rng(2), (400_000,))
    for true in (0.1, 0.4, 0.7, 0.9):
        seen = np.minimum(true * speckle, 1).mean()
        found = _correct_saturation(np.full((1, 1), seen, dtype=np.float32), CONTRAST)
        assert found[0, 0] == pytest.approx(true, abs=0.01)


@pytest.mark.parametrize("seed", range(4))
def test_it_comes_closer_everywhere_than_raw_and_mask(seed: int) -> None:
    clean = draw_scene()
    image = spoil(clean, seed)
    cleaned = clean_up(image)
    support = clean > 0
    assert measure_psnr(cleaned, clean) > measure_psnr(image, clean) + 8
    assert measure_psnr(cleaned[support], clean[support]) > measure_psnr(image[support], clean[support]) + 6
    masked = mask_image(Frame(0, 0.0, image, ~VALID), Config())
    assert measure_psnr(masked, clean) < measure_psnr(cleaned, clean) - 5
    inside = cleaned[140:220, 30:80]
    assert inside.mean() == pytest.approx(0.25, rel=0.08) and inside.std() < 0.4 * image[140:220, 30:80].std()
    assert cleaned[60:70, 110:130].mean() > 0.5 > 0.1 > cleaned[60:70, 30:50].mean(), "mirrored, it would be the echo"


@pytest.mark.parametrize("seed", range(3))
def test_empty_water_becomes_dark(seed: int) -> None:
    cleaned = clean_up(spoil(np.zeros(SHAPE, dtype=np.float32), seed))
    assert np.mean(cleaned > 0.02) < 0.05


def test_an_image_without_noise_is_left_as_it_is() -> None:
    clean = draw_scene()
    np.testing.assert_allclose(clean_up(clean), clean, atol=1e-6)


def test_shrinkage_without_noise_changes_nothing() -> None:
    clean = draw_scene()
    np.testing.assert_array_equal(shrink_noise(clean, clean, estimate_noise(clean, VALID)), clean)


def test_what_is_no_data_is_zero_and_disturbs_nothing_far_away() -> None:
    image, invalid = spoil(draw_scene(), 5), np.zeros(SHAPE, dtype=bool)
    invalid[140:200, 60:75] = True
    cleaned = clean_up(np.where(invalid, np.float32(1), image), invalid)
    assert not cleaned[invalid].any()
    np.testing.assert_array_equal(cleaned, clean_up(np.where(invalid, np.float32(0.3), image), invalid))
    away = np.ones(SHAPE, dtype=bool)
    away[110:230, 30:105] = False
    np.testing.assert_allclose(cleaned[away], clean_up(image)[away], atol=0.05)
    assert not clean_up(image, ~invalid | invalid).any()


def test_what_is_no_number_is_no_data() -> None:
    image, invalid = spoil(draw_scene(), 8), np.zeros(SHAPE, dtype=bool)
    invalid[150:160, 40:50] = True
    holed = np.where(invalid, np.float32(np.nan), image)
    np.testing.assert_array_equal(clean_up(holed), clean_up(image, invalid))
    assert np.isfinite(mask_image(Frame(0, 0.0, holed, ~VALID), Config())).all()
    assert not clean_up(np.full(SHAPE, np.nan, dtype=np.float32)).any()


@pytest.mark.parametrize("value", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (2, 2), (11, 11), (120, 90)])
def test_an_even_image_stays_even(shape: tuple[int, int], value: float) -> None:
    cleaned = clean_up(np.full(shape, value, dtype=np.float32))
    assert cleaned.shape == shape and cleaned.dtype == np.float32
    assert np.ptp(cleaned) < 1e-5 and np.isfinite(cleaned).all()
    assert cleaned[0, 0] == pytest.approx(value) or cleaned[0, 0] == 0


@pytest.mark.parametrize("shape", [(3, 7), (30, 5), (5, 200), (700, 12)])
def test_noise_of_any_shape_gives_an_image(shape: tuple[int, int]) -> None:
    cleaned = clean_up(np.random.default_rng(0).uniform(size=shape).astype(np.float32))
    assert cleaned.shape == shape and cleaned.min() >= 0 and cleaned.max() <= 1


def test_logarithmic_images_are_cleaned_as_amplitudes_and_come_back_logarithmic() -> None:
    amplitude = np.maximum(spoil(draw_scene(), 6), np.float32(1e-4))
    span = 80.0
    image = np.asarray(1 + 20 * np.log10(amplitude) / span, dtype=np.float32)
    cleaned, plain = clean_up(image, span=span), clean_up(amplitude)
    echo = plain > 0.05
    np.testing.assert_allclose(10 ** ((cleaned[echo] - 1) * span / 20), plain[echo], rtol=2e-3)
    assert cleaned.min() >= 0 and cleaned.max() <= 1


def test_the_same_image_gives_the_same_bytes_and_is_left_alone() -> None:
    image = spoil(draw_scene(), 7)
    image.flags.writeable = False
    np.testing.assert_array_equal(clean_up(image), clean_up(image))
