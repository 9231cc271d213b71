"""PSNR and SSIM against independent implementations."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from skimage.metrics import peak_signal_noise_ratio

from asfm.errors import AsfmError
from asfm.evaluation.denoising.metrics import average_denoising, measure_denoising, measure_psnr
from asfm.types import FloatArray, ImageArray


def images(seed: int = 0, sigma: float = 0.1) -> tuple[ImageArray, ImageArray]:
    rng = np.random.default_rng(seed)
    clean = gaussian_filter(rng.uniform(size=(60, 40)), 2)
    clean = (clean - clean.min()) / np.ptp(clean)
    noisy = np.clip(clean + rng.normal(scale=sigma, size=clean.shape), 0, 1)
    return noisy.astype(np.float32), clean.astype(np.float32)


def plain_ssim(image: FloatArray, clean: FloatArray) -> float:
    """Compute equation 13 of Wang et al. 2004 with a window of 11 pixels, averaged without the border."""

    def blur(values: FloatArray) -> FloatArray:
        return np.asarray(gaussian_filter(values, 1.5, radius=5))

    mean_x, mean_y = blur(image), blur(clean)
    variance_x, variance_y = blur(image**2) - mean_x**2, blur(clean**2) - mean_y**2
    covariance = blur(image * clean) - mean_x * mean_y
    c1, c2 = 0.01**2, 0.03**2
    similarity = (2 * mean_x * mean_y + c1) * (2 * covariance + c2)
    similarity /= (mean_x**2 + mean_y**2 + c1) * (variance_x + variance_y + c2)
    return float(similarity[5:-5, 5:-5].mean())


@pytest.mark.parametrize("seed", range(4))
def test_measures_agree_with_independent_ones(seed: int) -> None:
    image, clean = images(seed)
    support = clean > 0.5
    quality = measure_denoising(image, clean, support)
    assert quality.psnr_db == pytest.approx(peak_signal_noise_ratio(clean, image, data_range=1.0), abs=1e-4)
    assert quality.ssim == pytest.approx(plain_ssim(image.astype(float), clean.astype(float)), abs=1e-4)
    inside = peak_signal_noise_ratio(clean[support], image[support], data_range=1.0)
    assert quality.support_psnr_db == pytest.approx(inside, abs=1e-4)


def test_psnr_of_known_errors() -> None:
    zeros = np.zeros((4, 4), dtype=np.float32)
    assert measure_psnr(zeros + 0.1, zeros) == pytest.approx(20.0, abs=1e-5)
    assert measure_psnr(zeros + 1, zeros) == pytest.approx(0.0)


def test_equal_images_have_100_db_and_ssim_1() -> None:
    _, clean = images()
    quality = measure_denoising(clean, clean, clean > 0.5)
    assert quality.psnr_db == quality.support_psnr_db == pytest.approx(100.0)
    assert quality.ssim == pytest.approx(1.0)


def test_more_noise_is_worse_by_every_measure() -> None:
    qualities = [measure_denoising(*images(1, sigma), images(1)[1] > 0.5) for sigma in (0.02, 0.1, 0.3)]
    for name in ("psnr_db", "ssim", "support_psnr_db"):
        values = [getattr(quality, name) for quality in qualities]
        assert values == sorted(values, reverse=True)


def test_masking_everything_raises_psnr_and_lowers_it_in_the_support() -> None:
    rng = np.random.default_rng(0)
    clean = np.zeros((60, 40), dtype=np.float32)
    clean[20:24, 10:20] = 0.8
    noisy = np.clip(clean + rng.normal(scale=0.2, size=clean.shape), 0, 1).astype(np.float32)
    raw, masked = (measure_denoising(image, clean, clean > 0) for image in (noisy, np.zeros_like(clean)))
    assert masked.psnr_db > raw.psnr_db
    assert masked.support_psnr_db is not None
    assert raw.support_psnr_db is not None
    assert masked.support_psnr_db < raw.support_psnr_db


def test_an_empty_support_has_no_psnr() -> None:
    image, clean = images()
    assert measure_denoising(image, clean, np.zeros(clean.shape, dtype=bool)).support_psnr_db is None


def test_averages_are_over_frames() -> None:
    image, clean = images()
    some, none = (measure_denoising(image, clean, support) for support in (clean > 0.5, clean > 2))
    perfect = measure_denoising(clean, clean, clean > 0.5)
    mean = average_denoising([some, none, perfect])
    assert mean.psnr_db == pytest.approx((2 * some.psnr_db + 100) / 3)
    assert some.support_psnr_db is not None
    assert mean.support_psnr_db == pytest.approx((some.support_psnr_db + 100) / 2)
    assert average_denoising([none]).support_psnr_db is None


def test_different_shapes_and_small_images_are_an_error() -> None:
    image, clean = images()
    with pytest.raises(AsfmError, match="one shape"):
        measure_denoising(image[:-1], clean, clean > 0)
    with pytest.raises(AsfmError, match="11 x 11"):
        measure_denoising(image[:10], clean[:10], clean[:10] > 0)
