"""The ways of denoising that are compared: each a function from a frame to an image, with its method's own setting.

Where a method needs the noise's sigma, it gets scikit-image's ``estimate_sigma``: the median absolute deviation of the
finest wavelet coefficients (Donoho and Johnstone 1994). The factors by which non-local means and total variation take
it, and the window of the median, are those with the best mean PSNR over simulated scenes of another seed, in favour of
the methods. All of them see the whole image and none of them knows of the noise floor: that is what plain methods do.
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
MEDIAN_PX = 3
PATCH_PX, SEARCH_PX = 5, 13
SIGMA_TO_STRENGTH = 1.5
SIGMA_TO_WEIGHT = 3.0
ITERATIONS = 50
ROUNDING = 1e-6
LEAST_STEP = 0.5 / 255
"""Noise below half a count of eight bits is none."""


def keep_raw(frame: Frame, config: Config) -> ImageArray:
    """Leave the image as it is."""
    return frame.image


def denoise_by_wavelet(frame: Frame, config: Config) -> ImageArray:
    """Shrink wavelet coefficients by BayesShrink (Chang, Yu and Vetterli 2000), soft, with scikit-image's defaults."""
    if _estimate_sigma(frame.image) < ROUNDING:  # BayesShrink divides by it
        return frame.image
    shrunk = denoise_wavelet(frame.image, method="BayesShrink", mode="soft", rescale_sigma=True)
    return np.asarray(np.clip(np.nan_to_num(shrunk), 0, 1), dtype=np.float32)


def denoise_by_median(frame: Frame, config: Config) -> ImageArray:
    """Take the median of 3 x 3 pixels."""
    return np.asarray(cv2.medianBlur(frame.image, MEDIAN_PX))


def denoise_by_nonlocal_means(frame: Frame, config: Config) -> ImageArray:
    """Average similar patches of 5 x 5 pixels within 13 x 13 (Buades et al. 2005, OpenCV), h = 1.5 sigma, in 8 bits."""
    strength = SIGMA_TO_STRENGTH * _estimate_sigma(frame.image)
    if strength < LEAST_STEP:
        return frame.image
    counts = np.rint(255 * frame.image).astype(np.uint8)
    averaged = cv2.fastNlMeansDenoising(
        counts, None, h=255 * strength, templateWindowSize=PATCH_PX, searchWindowSize=SEARCH_PX
    )
    return np.asarray(averaged / np.float32(255))


def denoise_by_total_variation(frame: Frame, config: Config) -> ImageArray:
    """Minimise total variation (Rudin, Osher and Fatemi 1992; Chambolle 2004, scikit-image), weight = 3 sigma."""
    weight = SIGMA_TO_WEIGHT * _estimate_sigma(frame.image)
    if weight < LEAST_STEP:
        return frame.image
    smooth = denoise_tv_chambolle(frame.image, weight=weight, max_num_iter=ITERATIONS)
    return np.asarray(np.clip(smooth, 0, 1), dtype=np.float32)


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
"""By the names under which they are printed; ``mask alone`` is the paper's: CFAR, DBSCAN, zero elsewhere."""


def _estimate_sigma(image: ImageArray) -> float:
    """Estimate the noise's sigma; zero where no wavelet coefficient tells of any."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of the median of nothing
        return float(np.nan_to_num(estimate_sigma(image)))
