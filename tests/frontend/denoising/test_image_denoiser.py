"""Image denoiser: noise removed, echoes kept, saturation corrected, and images without noise unchanged."""

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from asfm.config import Config
from asfm.evaluation.denoising.metrics import measure_psnr
from asfm.frontend.denoising.dbscan import dbscan_mask
from asfm.frontend.denoising.image_denoiser import _correct_saturation, _echo_threshold, denoise_image, mask_image
from asfm.frontend.denoising.noise_model import ImageNoise, estimate_noise, smooth_echoes
from asfm.types import BoolArray, FloatArray, Frame, ImageArray

SHAPE = (300, 160)
VALID = np.ones(SHAPE, dtype=bool)
CONTRAST = 0.35


def draw_speckle(rng: np.random.Generator, shape: tuple[int, ...] = SHAPE) -> FloatArray:
    """Draw Weibull speckle of mean 1 and contrast 0.35, that of the simulated sonars."""
    speckle = rng.weibull(1 / 0.3235, shape)
    return np.asarray(speckle / 0.8956)


def draw_scene() -> ImageArray:
    """Draw a wide echo to starboard and a small bright one to port, without noise."""
    clean = np.zeros(SHAPE, dtype=np.float32)
    clean[120:240, 10:100] = 0.25
    clean[60:70, 110:130] = 0.7
    return clean


def add_noise(clean: ImageArray, seed: int) -> ImageArray:
    """Multiply by speckle and add Rayleigh noise."""
    rng = np.random.default_rng(seed)
    return np.clip(clean * draw_speckle(rng) + rng.rayleigh(1, SHAPE) * 0.04, 0, 1).astype(np.float32)


def denoise(image: ImageArray, invalid: BoolArray | None = None, span: float | None = None) -> ImageArray:
    invalid = np.zeros(image.shape, dtype=bool) if invalid is None else invalid
    return denoise_image(Frame(0, 0.0, image, invalid, span), Config())


def test_the_mean_of_saturated_speckle_is_corrected() -> None:
    speckle = draw_speckle(np.random.default_rng(2), (400_000,))
    for true in (0.1, 0.4, 0.7, 0.9):
        saturated = np.minimum(true * speckle, 1).mean()
        found = _correct_saturation(np.full((1, 1), saturated, dtype=np.float32), CONTRAST)
        assert found[0, 0] == pytest.approx(true, abs=0.01)


@pytest.mark.parametrize("seed", range(4))
def test_denoised_images_are_closer_to_the_truth_than_raw_and_masked_ones(seed: int) -> None:
    clean = draw_scene()
    image = add_noise(clean, seed)
    denoised = denoise(image)
    support = clean > 0
    assert measure_psnr(denoised, clean) > measure_psnr(image, clean) + 8
    assert measure_psnr(denoised[support], clean[support]) > measure_psnr(image[support], clean[support]) + 6
    masked = mask_image(Frame(0, 0.0, image, ~VALID), Config())
    assert measure_psnr(masked, clean) < measure_psnr(denoised, clean) - 5
    inside = denoised[140:220, 30:80]
    assert inside.mean() == pytest.approx(0.25, rel=0.08) and inside.std() < 0.4 * image[140:220, 30:80].std()
    assert denoised[60:70, 110:130].mean() > 0.5 > 0.1 > denoised[60:70, 30:50].mean(), "mirrored, it would be the echo"


def test_bright_speckle_keeps_its_mean() -> None:
    """The brightest pixels of an echo of 0.7 saturate, which alone would lower its mean to 0.675."""
    clean = np.zeros(SHAPE, dtype=np.float32)
    clean[120:240, 10:140] = 0.7
    image = add_noise(clean, 9)
    assert (image == 1).mean() > 0.02
    assert denoise(image)[140:220, 30:120].mean() == pytest.approx(0.7, abs=0.012)


@pytest.mark.parametrize("contrast", [0.1, 0.52, 2.0])
def test_echoes_exceed_the_smoothed_background_by_its_noise_and_by_a_half(contrast: float) -> None:
    floor = np.full((SHAPE[0], 1), 0.04, dtype=np.float32)
    noise = ImageNoise(floor, (contrast * floor) ** 2, 0.0, 0.0)
    white = np.random.default_rng(0).normal(0.0, contrast * 0.04, (800, 800)).astype(np.float32)
    expected = max(0.04 + 5 * float(smooth_echoes(white).std()), 1.5 * 0.04)
    np.testing.assert_allclose(_echo_threshold(noise), expected, rtol=0.02)


def test_detections_of_cfar_are_kept_however_weak(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of the pixels of empty water are above its mean."""
    image, detected = add_noise(np.zeros(SHAPE, dtype=np.float32), 3), np.zeros(SHAPE, dtype=bool)
    before = denoise(image)
    detected[100:140, 40:90] = True
    monkeypatch.setattr("asfm.frontend.denoising.image_denoiser.detect_echo_mask", lambda *_: detected)
    after = denoise(image)
    assert (before[detected] > 0).mean() < 0.05 < 0.2 < (after[detected] > 0).mean()
    assert (after[~detected] > 0).mean() < 0.05


def test_echoes_keep_the_pixels_beside_those_above_the_threshold(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of them that are brighter than the background, which is subtracted."""
    image = add_noise(draw_scene(), 4)
    monkeypatch.setattr("asfm.frontend.denoising.image_denoiser.detect_echo_mask", lambda *_: ~VALID)
    above = smooth_echoes(image) > _echo_threshold(estimate_noise(image, VALID))
    above = dbscan_mask(np.asarray(above), Config().clusters)
    grown, found = binary_dilation(above, np.ones((3, 3))), denoise(image) > 0
    assert found[grown & ~above].mean() > 0.2 and not found[~grown].any()


@pytest.mark.parametrize("seed", range(3))
def test_empty_water_becomes_dark(seed: int) -> None:
    denoised = denoise(add_noise(np.zeros(SHAPE, dtype=np.float32), seed))
    assert np.mean(denoised > 0.02) < 0.05


def test_an_image_without_noise_is_unchanged() -> None:
    clean = draw_scene()
    np.testing.assert_allclose(denoise(clean), clean, atol=1e-6)


def test_invalid_pixels_are_zero_and_have_no_effect_far_away() -> None:
    image, invalid = add_noise(draw_scene(), 5), np.zeros(SHAPE, dtype=bool)
    invalid[140:200, 60:75] = True
    denoised = denoise(np.where(invalid, np.float32(1), image), invalid)
    assert not denoised[invalid].any()
    np.testing.assert_array_equal(denoised, denoise(np.where(invalid, np.float32(0.3), image), invalid))
    away = np.ones(SHAPE, dtype=bool)
    away[110:230, 30:105] = False
    np.testing.assert_allclose(denoised[away], denoise(image)[away], atol=0.05)
    assert not denoise(image, ~invalid | invalid).any()


@pytest.mark.parametrize("seed", [5, 6])
def test_an_echo_is_as_bright_beside_invalid_pixels_as_without_them(seed: int) -> None:
    image, invalid, beside = add_noise(draw_scene(), seed), ~VALID, ~VALID
    invalid[150:200, 40:75] = beside[148:202, 38:77] = True
    beside &= ~invalid
    assert denoise(image, invalid)[beside].mean() == pytest.approx(denoise(image)[beside].mean(), rel=0.03)


def test_non_finite_pixels_are_invalid() -> None:
    image, invalid = add_noise(draw_scene(), 8), np.zeros(SHAPE, dtype=bool)
    invalid[150:160, 40:50] = True
    holed = np.where(invalid, np.float32(np.nan), image)
    np.testing.assert_array_equal(denoise(holed), denoise(image, invalid))
    assert np.isfinite(mask_image(Frame(0, 0.0, holed, ~VALID), Config())).all()
    assert not denoise(np.full(SHAPE, np.nan, dtype=np.float32)).any()


@pytest.mark.parametrize("value", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (2, 2), (11, 11), (120, 90)])
def test_a_uniform_image_stays_uniform(shape: tuple[int, int], value: float) -> None:
    denoised = denoise(np.full(shape, value, dtype=np.float32))
    assert denoised.shape == shape and denoised.dtype == np.float32
    assert np.ptp(denoised) < 1e-5 and np.isfinite(denoised).all()
    assert denoised[0, 0] == pytest.approx(value if min(shape) > 2 else 0.0), "a few pixels hold no cluster of echoes"


@pytest.mark.parametrize("shape", [(3, 7), (30, 5), (5, 200), (700, 12)])
def test_noise_images_of_any_shape_are_denoised(shape: tuple[int, int]) -> None:
    denoised = denoise(np.random.default_rng(0).uniform(size=shape).astype(np.float32))
    assert denoised.shape == shape and denoised.min() >= 0 and denoised.max() <= 1


def test_logarithmic_images_are_denoised_as_amplitudes() -> None:
    amplitude = np.maximum(add_noise(draw_scene(), 6), np.float32(1e-4))
    span = 80.0
    image = np.asarray(1 + 20 * np.log10(amplitude) / span, dtype=np.float32)
    denoised, plain = denoise(image, span=span), denoise(amplitude)
    echo = plain > 0.05
    np.testing.assert_allclose(10 ** ((denoised[echo] - 1) * span / 20), plain[echo], rtol=2e-3)
    assert denoised.min() >= 0 and denoised.max() <= 1


def test_the_result_is_deterministic_and_the_image_not_modified() -> None:
    image = add_noise(draw_scene(), 7)
    before = image.copy()
    image.flags.writeable = False
    np.testing.assert_array_equal(denoise(image), denoise(image))
    np.testing.assert_array_equal(image, before)
