"""Denoising methods under comparison: wavelet, median, non-local means, total variation, echo mask and ours.

Methods that need the standard deviation of the noise use scikit-image's ``estimate_sigma``, the median absolute
deviation of the finest wavelet coefficients (Donoho and Johnstone 1994). To favour the baselines, their parameters are
those with the best mean PSNR over simulated scenes of another seed. Baselines process the whole image without a model
of the noise floor.
"""

import warnings
from collections.abc import Callable

import cv2
import numpy as np
from skimage.restoration import denoise_tv_chambolle, denoise_wavelet, estimate_sigma

from asfm.config import Config
from asfm.frontend.denoising.image_denoiser import denoise_image, mask_image
from asfm.types import Frame, ImageArray

Denoiser = Callable[[Frame, Config], ImageArray]
"""Function from a frame to the denoised (ranges, beams) image in 0..1."""

MEDIAN_PX = 3
PATCH_PX, SEARCH_PX = 5, 13
SIGMA_TO_STRENGTH = 1.5
SIGMA_TO_WEIGHT = 3.0
MAX_ITERATIONS = 50
MIN_WAVELET_SIGMA = 1e-6
MIN_FILTER_STRENGTH = 0.5 / 255
"""Half a grey level of 8 bits; images with less noise are returned unchanged."""


def keep_raw(frame: Frame, _config: Config) -> ImageArray:
    """Return the image unchanged."""
    return frame.image


def denoise_by_wavelet(frame: Frame, _config: Config) -> ImageArray:
    """Apply BayesShrink (Chang, Yu and Vetterli 2000) with soft thresholds and scikit-image's defaults."""
    if _estimate_sigma(frame.image) < MIN_WAVELET_SIGMA:  # BayesShrink divides by it
        return frame.image
    shrunk = denoise_wavelet(frame.image, method="BayesShrink", mode="soft", rescale_sigma=True)
    return np.asarray(np.clip(np.nan_to_num(shrunk), 0, 1), dtype=np.float32)


def denoise_by_median(frame: Frame, _config: Config) -> ImageArray:
    """Apply a median filter of 3 x 3 pixels."""
    return np.asarray(cv2.medianBlur(frame.image, MEDIAN_PX))


def denoise_by_nonlocal_means(frame: Frame, _config: Config) -> ImageArray:
    """Apply non-local means (Buades et al. 2005, OpenCV, 8 bits): patches 5 x 5, search 13 x 13, h = 1.5 sigma."""
    strength = SIGMA_TO_STRENGTH * _estimate_sigma(frame.image)
    if strength < MIN_FILTER_STRENGTH:
        return frame.image
    image_8_bit = np.rint(255 * frame.image).astype(np.uint8)
    denoised = cv2.fastNlMeansDenoising(
        image_8_bit, None, h=255 * strength, templateWindowSize=PATCH_PX, searchWindowSize=SEARCH_PX
    )
    return np.asarray(denoised / np.float32(255))


def denoise_by_total_variation(frame: Frame, _config: Config) -> ImageArray:
    """Apply total variation denoising (Rudin et al. 1992; Chambolle 2004, scikit-image) of weight 3 sigma."""
    weight = SIGMA_TO_WEIGHT * _estimate_sigma(frame.image)
    if weight < MIN_FILTER_STRENGTH:
        return frame.image
    denoised = denoise_tv_chambolle(frame.image, weight=weight, max_num_iter=MAX_ITERATIONS)
    return np.asarray(np.clip(denoised, 0, 1), dtype=np.float32)


RAW, WAVELET, MASK, OURS = "raw", "wavelet", "mask alone", "ours"
DENOISERS: dict[str, Denoiser] = {
    RAW: keep_raw,
    WAVELET: denoise_by_wavelet,
    "median": denoise_by_median,
    "non-local means": denoise_by_nonlocal_means,
    "total variation": denoise_by_total_variation,
    MASK: mask_image,
    OURS: denoise_image,
}
"""Methods by the name that is printed; ``mask alone`` is the method of the paper, zero outside the echo mask."""


def _estimate_sigma(image: ImageArray) -> float:
    """Estimate the standard deviation of the noise; zero if all wavelet coefficients are zero."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # median of an empty array
        return float(np.nan_to_num(estimate_sigma(image)))
