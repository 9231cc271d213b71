"""Noise model of a sonar image: noise floor, background variance, beam correlation and speckle contrast.

All parameters are estimated from the image itself.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import grey_opening

from asfm.types import BoolArray, FloatArray, ImageArray

WINDOW_PX = 9
"""Side of the window of local means and variances."""
BANDS = 24
"""Bands of rows in which the floor is estimated."""
MIN_BACKGROUND_CONTRAST = 0.4
"""Standard deviation over mean of empty water: Rayleigh noise has 0.52, speckled echoes on it have less."""
MIN_BACKGROUND_SHARE = 0.03
"""A band with a smaller share of empty water gives no estimate."""
LOW_QUANTILE, LOW_QUANTILE_TO_MEAN = 0.1, 1.15
"""Weak echoes raise the mean of a band but not the low quantile of its local means; the factor turns it into a mean."""
BLANKED_BANDS = 2
"""Nearest bands, which sonars blank: they do not bound the floor at longer range."""
EMPTY_FACTOR = 1.15
"""Pixels of the smoothed image below this multiple of the floor are empty water."""
MIN_PIXELS = 200
ECHO_SIGMA_PX = 1.5
"""Gaussian smoothing before echoes are separated from the floor."""
BRIGHT_FACTOR, BRIGHT_VALUE = 4.0, 0.1
"""Speckle contrast is measured where the smoothed image exceeds this multiple of the floor and this value."""
SPECKLE_QUANTILE = 0.2
"""Texture adds to the contrast of speckle; this low quantile has the least of it."""
TEXTURE_CONTRAST, CONTRAST_GAIN = 0.15, 1.9
"""Contrast measured on simulated echoes without speckle, and the factor from the excess over it to speckle contrast."""
MAX_CONTRAST = 0.42


@dataclass(frozen=True)
class ImageNoise:
    """The noise of one (ranges, beams) image: Rayleigh-like background and multiplicative speckle on the echoes."""

    floor: ImageArray
    """(ranges, 1) mean of the background."""
    background_variance: ImageArray
    """(ranges, 1) variance of the background."""
    beam_correlation: float
    """Correlation of the background between neighbouring beams, 0..0.95; rows are uncorrelated."""
    contrast: float
    """Standard deviation over mean of the speckle; zero if the image has none."""


def estimate_noise(image: ImageArray, valid: BoolArray) -> ImageNoise:
    """Estimate background and speckle from one image of amplitudes.

    Args:
        image: (ranges, beams) non-negative amplitudes.
        valid: (ranges, beams) false where the pixel holds no data; such pixels are ignored.

    Returns:
        The noise; all its parameters are zero for an image without noise.
    """
    floor = estimate_floor(image, valid)
    smooth = smooth_echoes(image)
    empty = cv2.erode((valid & (smooth < EMPTY_FACTOR * floor)).view(np.uint8), np.ones((5, 5), np.uint8)).view(bool)
    if np.count_nonzero(empty) < MIN_PIXELS:
        empty = valid & (smooth <= np.quantile(smooth, 0.2))
    residual = image - cv2.blur(image, (WINDOW_PX, WINDOW_PX))
    power = float(np.mean(np.square(floor * np.ones_like(image))[empty])) if empty.any() else 0.0
    variance = float(np.mean(np.square(residual[empty]))) if power > 0 else 0.0
    both = empty[:, 1:] & empty[:, :-1]
    covariance = float(np.mean((residual[:, 1:] * residual[:, :-1])[both])) if variance > 0 and both.any() else 0.0
    return ImageNoise(
        floor,
        np.asarray(floor**2 * (variance / power if power > 0 else 0.0), dtype=np.float32),
        float(np.clip(covariance / variance, 0, 0.95)) if variance > 0 else 0.0,
        _estimate_contrast(image, valid & (smooth > np.maximum(BRIGHT_FACTOR * floor, BRIGHT_VALUE))),
    )


def smooth_echoes(image: ImageArray) -> ImageArray:
    """Smooth a (ranges, beams) image so that echoes of several pixels exceed the floor and single pixels do not."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), ECHO_SIGMA_PX))


def estimate_floor(image: ImageArray, valid: BoolArray) -> ImageArray:
    """Estimate the mean of the background of each row, the noise floor.

    In bands of rows the floor is a low quantile of the local means that have the contrast of empty water. Noise grows
    at most with the square of range, and its maxima are wider than half the image: anything above is a wide echo and is
    removed by a bound and by a morphological opening.

    Args:
        image: (ranges, beams) non-negative amplitudes.
        valid: (ranges, beams) false where the pixel holds no data.

    Returns:
        (ranges, 1) floor; zero if no band has the contrast of empty water.
    """
    window = (WINDOW_PX, WINDOW_PX)
    mean = cv2.blur(image, window)
    background = cv2.blur(image * image, window) - mean * mean >= np.square(MIN_BACKGROUND_CONTRAST * mean)
    background &= cv2.erode(valid.view(np.uint8), np.ones(window, np.uint8)).view(bool)
    count = min(BANDS, len(image))
    edges = np.linspace(0, len(image), count + 1).astype(int)
    known_centres, known_floor = [], []
    for band in range(count):
        rows = slice(edges[band], edges[band + 1])
        candidates = mean[rows][background[rows]]
        if candidates.size and candidates.size >= MIN_BACKGROUND_SHARE * mean[rows].size:
            known_centres.append(band + 0.5)
            known_floor.append(LOW_QUANTILE_TO_MEAN * np.quantile(candidates, LOW_QUANTILE))
    if not known_floor:
        return np.zeros((len(image), 1), dtype=np.float32)
    floor = _bound_floor(np.interp(np.arange(count) + 0.5, known_centres, known_floor))
    row_centres = (np.arange(len(image)) + 0.5) * count / len(image)
    return np.asarray(np.interp(row_centres, np.arange(count) + 0.5, floor), dtype=np.float32)[:, None]


def _bound_floor(floor: FloatArray) -> FloatArray:
    """Remove wide echoes from the floor of each band, nearest first: (B,)."""
    count = len(floor)
    centres = np.arange(count) + 0.5
    growth = floor / centres**2
    growth[: min(BLANKED_BANDS, count - 1)] = np.inf
    floor = np.minimum(floor, np.minimum.accumulate(growth) * centres**2)
    width = count // 2 | 1
    return np.asarray(grey_opening(np.pad(floor, width, mode="edge"), width)[width:-width])


def _estimate_contrast(image: ImageArray, bright: BoolArray) -> float:
    """Estimate the speckle contrast of bright pixels from neighbours along range, whose speckle is independent."""
    if np.count_nonzero(bright) < MIN_PIXELS:
        return 0.0
    difference, total = np.zeros_like(image), np.zeros_like(image)
    difference[1:], total[1:] = image[1:] - image[:-1], image[1:] + image[:-1]
    ratio = cv2.blur(difference**2, (7, 7))[bright] / np.maximum(cv2.blur(total**2, (7, 7))[bright], 1e-9)
    squared_contrast = 2 * float(np.quantile(ratio, SPECKLE_QUANTILE))
    return min(CONTRAST_GAIN * math.sqrt(max(squared_contrast - TEXTURE_CONTRAST**2, 0.0)), MAX_CONTRAST)
