"""What an image tells of its own noise: the floor under the echoes and the contrast of their speckle."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import grey_opening

from asfm.types import BoolArray, ImageArray

WINDOW_PX = 9
BANDS = 24
LEAST_CONTRAST = 0.4
"""Standard deviation over mean of what passes for empty water: Rayleigh noise has 0.52, speckled echoes on it less."""
LEAST_SHARE = 0.03
LOW_QUANTILE, LOW_QUANTILE_TO_MEAN = 0.1, 1.15
"""Weak echoes raise the mean of a band, not its low quantile: that of means over a window, and what makes it a mean."""
NEAR_BANDS = 2
"""Sonars blank what is near: it does not bound the noise of the rest."""
EMPTY_FACTOR = 1.15
FEW_PIXELS = 200
ECHO_SIGMA_PX = 1.5
BRIGHT_FACTOR, BRIGHT_VALUE = 4.0, 0.1
STEADY_QUANTILE = 0.2
"""Texture adds to speckle's contrast; where it does least, speckle shows."""
TEXTURE_CONTRAST, CONTRAST_GAIN = 0.15, 1.9
"""What simulated echoes without speckle reach by that measure, and what turns the rest into contrast."""
LARGEST_CONTRAST = 0.42


@dataclass(frozen=True)
class ImageNoise:
    """The noise of one (ranges, beams) image: Rayleigh-like background, and speckle that multiplies the echoes."""

    floor: ImageArray
    """(ranges, 1) mean of the background."""
    background_variance: ImageArray
    """(ranges, 1)"""
    beam_correlation: float
    """Between neighbouring beams, 0..0.95; between rows there is none."""
    contrast: float
    """Standard deviation over mean of the speckle; zero where the image has none."""


def estimate_noise(image: ImageArray, valid: BoolArray) -> ImageNoise:
    """Estimate background and speckle from one image of amplitudes; an image without noise has none of both.

    Args:
        image: (ranges, beams) amplitudes of 0 or more.
        valid: (ranges, beams) false where the pixel holds no data; such a pixel counts for nothing.
    """
    floor = estimate_floor(image, valid)
    smooth = smooth_echoes(image)
    empty = cv2.erode((valid & (smooth < EMPTY_FACTOR * floor)).view(np.uint8), np.ones((5, 5), np.uint8)).view(bool)
    if np.count_nonzero(empty) < FEW_PIXELS:
        empty = valid & (smooth <= np.quantile(smooth, 0.2))
    rough = image - cv2.blur(image, (WINDOW_PX, WINDOW_PX))
    power = float(np.mean(np.square(floor * np.ones_like(image))[empty])) if empty.any() else 0.0
    variance = float(np.mean(np.square(rough[empty]))) if power > 0 else 0.0
    both = empty[:, 1:] & empty[:, :-1]
    shared = float(np.mean((rough[:, 1:] * rough[:, :-1])[both])) if variance > 0 and both.any() else 0.0
    return ImageNoise(
        floor,
        np.asarray(floor**2 * (variance / power if power > 0 else 0.0), dtype=np.float32),
        float(np.clip(shared / variance, 0, 0.95)) if variance > 0 else 0.0,
        _estimate_contrast(image, valid & (smooth > np.maximum(BRIGHT_FACTOR * floor, BRIGHT_VALUE))),
    )


def smooth_echoes(image: ImageArray) -> ImageArray:
    """Calm the speckle, so that echoes of some pixels stand out of the floor and lone pixels do not."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), ECHO_SIGMA_PX))


def estimate_floor(image: ImageArray, valid: BoolArray) -> ImageArray:
    """Estimate the mean of the background of each row: (ranges, 1).

    In bands of rows, the low end of what is rough enough for empty water. Noise grows at most with the square of range,
    and its bumps are broader than half the image: what exceeds that are wide echoes.
    """
    window = (WINDOW_PX, WINDOW_PX)
    mean = cv2.blur(image, window)
    rough = cv2.blur(image * image, window) - mean * mean >= np.square(LEAST_CONTRAST * mean)
    rough &= cv2.erode(valid.view(np.uint8), np.ones(window, np.uint8)).view(bool)
    count = min(BANDS, len(image))
    edges = np.linspace(0, len(image), count + 1).astype(int)
    middle, found = [], []
    for band in range(count):
        rows = slice(edges[band], edges[band + 1])
        candidates = mean[rows][rough[rows]]
        if candidates.size and candidates.size >= LEAST_SHARE * mean[rows].size:
            middle.append(band + 0.5)
            found.append(LOW_QUANTILE_TO_MEAN * np.quantile(candidates, LOW_QUANTILE))
    if not found:
        return np.zeros((len(image), 1), dtype=np.float32)
    centres = np.arange(count) + 0.5
    floor = np.interp(centres, middle, found)
    growth = floor / centres**2
    growth[: min(NEAR_BANDS, count - 1)] = np.inf
    floor = np.minimum(floor, np.minimum.accumulate(growth) * centres**2)
    width = count // 2 | 1
    floor = grey_opening(np.pad(floor, width, mode="edge"), width)[width:-width]
    rows_in_bands = (np.arange(len(image)) + 0.5) * count / len(image)
    return np.asarray(np.interp(rows_in_bands, centres, floor), dtype=np.float32)[:, None]


def _estimate_contrast(image: ImageArray, bright: BoolArray) -> float:
    """Estimate speckle's contrast from how neighbours along range, whose speckle is independent, differ."""
    if np.count_nonzero(bright) < FEW_PIXELS:
        return 0.0
    difference, total = np.zeros_like(image), np.zeros_like(image)
    difference[1:], total[1:] = image[1:] - image[:-1], image[1:] + image[:-1]
    ratio = cv2.blur(difference**2, (7, 7))[bright] / np.maximum(cv2.blur(total**2, (7, 7))[bright], 1e-9)
    apparent = 2 * float(np.quantile(ratio, STEADY_QUANTILE))
    return min(CONTRAST_GAIN * math.sqrt(max(apparent - TEXTURE_CONTRAST**2, 0.0)), LARGEST_CONTRAST)
