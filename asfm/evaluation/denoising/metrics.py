"""Denoising quality: PSNR, SSIM, and PSNR inside the support of the true echoes.

PSNR of the whole image favours masking and is therefore always reported with the other two.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from asfm.errors import AsfmError
from asfm.types import BoolArray, ImageArray

MIN_MSE = 1e-10
"""Bound of the mean squared error: equal images have 100 dB, and 8-bit rounding alone has 59 dB."""
SSIM_WINDOW_PX = 11


@dataclass(frozen=True)
class DenoisingQuality:
    """Similarity of a denoised image to the noise-free one."""

    psnr_db: float
    ssim: float
    support_psnr_db: float | None
    """PSNR over the pixels with a true echo, which masked echoes lower; None without any."""


def measure_psnr(image: ImageArray, clean: ImageArray) -> float:
    """Compute the peak signal-to-noise ratio in dB of two arrays of the same shape with values in 0..1."""
    mse = np.mean(np.square(np.asarray(image, dtype=float) - np.asarray(clean, dtype=float)))
    return float(-10 * np.log10(max(mse, MIN_MSE)))


def measure_denoising(image: ImageArray, clean: ImageArray, support: BoolArray) -> DenoisingQuality:
    """Compare an image with the noise-free one by PSNR and SSIM.

    SSIM is that of Wang et al. 2004, with a Gaussian window of sigma 1.5 pixels.

    Args:
        image: (ranges, beams) in 0..1, denoised or raw.
        clean: (ranges, beams) in 0..1 without noise.
        support: (ranges, beams) true where there is a true echo.

    Returns:
        The quality of the image.

    Raises:
        AsfmError: the shapes differ, or are smaller than the window of SSIM.
    """
    from skimage.metrics import structural_similarity

    if not image.shape == clean.shape == support.shape or min(image.shape) < SSIM_WINDOW_PX:
        raise AsfmError(
            f"denoising quality: expected image, clean image and support of one shape, at least {SSIM_WINDOW_PX} x "
            f"{SSIM_WINDOW_PX} pixels, found {image.shape}, {clean.shape} and {support.shape}"
        )
    ssim = structural_similarity(
        image, clean, data_range=1.0, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )
    support_psnr_db = measure_psnr(image[support], clean[support]) if support.any() else None
    return DenoisingQuality(measure_psnr(image, clean), float(ssim), support_psnr_db)


def average_denoising(qualities: Sequence[DenoisingQuality]) -> DenoisingQuality:
    """Average the quality of one or more frames; the support's PSNR over the frames that have a support."""
    support_psnr_db = [quality.support_psnr_db for quality in qualities if quality.support_psnr_db is not None]
    return DenoisingQuality(
        psnr_db=float(np.mean([quality.psnr_db for quality in qualities])),
        ssim=float(np.mean([quality.ssim for quality in qualities])),
        support_psnr_db=float(np.mean(support_psnr_db)) if support_psnr_db else None,
    )
