"""How close a cleaned image comes to the one without noise. PSNR alone favours masking, so it never stands alone."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from asfm.errors import AsfmError
from asfm.types import BoolArray, ImageArray

SMALLEST_MSE = 1e-10
"""Equal images give 100 dB rather than infinity; the rounding of 8 bits alone gives 59 dB."""
SSIM_WINDOW_PX = 11


@dataclass(frozen=True)
class DenoisingQuality:
    """Likeness to the image without noise."""

    psnr_db: float
    ssim: float
    support_psnr_db: float | None
    """PSNR of the pixels where something truly echoes: masking them away costs here. None where nothing echoes."""


def measure_psnr(image: ImageArray, clean: ImageArray) -> float:
    """Give the peak signal-to-noise ratio in dB of two arrays of one shape with values in 0..1."""
    mse = np.mean(np.square(np.asarray(image, dtype=float) - np.asarray(clean, dtype=float)))
    return float(-10 * np.log10(max(mse, SMALLEST_MSE)))


def measure_denoising(image: ImageArray, clean: ImageArray, support: BoolArray) -> DenoisingQuality:
    """Compare a (ranges, beams) image in 0..1 with the one without noise.

    SSIM is Wang et al. 2004: a Gaussian window of sigma 1.5 pixels.

    Args:
        image: (ranges, beams), the cleaned or the raw image.
        clean: (ranges, beams), the same without noise.
        support: (ranges, beams), true where something truly echoes.

    Raises:
        AsfmError: the three differ in shape, or are smaller than the window of SSIM.
    """
    from skimage.metrics import structural_similarity

    if not image.shape == clean.shape == support.shape or min(image.shape) < SSIM_WINDOW_PX:
        raise AsfmError(
            f"expected image, clean image and support of one shape, at least {SSIM_WINDOW_PX} x {SSIM_WINDOW_PX}, "
            f"found {image.shape}, {clean.shape} and {support.shape}"
        )
    ssim = structural_similarity(
        image, clean, data_range=1.0, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )
    inside = measure_psnr(image[support], clean[support]) if support.any() else None
    return DenoisingQuality(measure_psnr(image, clean), float(ssim), inside)


def average_denoising(qualities: Sequence[DenoisingQuality]) -> DenoisingQuality:
    """Average over frames, one or more; the PSNR of the support over the frames that have one."""
    inside = [quality.support_psnr_db for quality in qualities if quality.support_psnr_db is not None]
    return DenoisingQuality(
        psnr_db=float(np.mean([quality.psnr_db for quality in qualities])),
        ssim=float(np.mean([quality.ssim for quality in qualities])),
        support_psnr_db=float(np.mean(inside)) if inside else None,
    )
