"""Wiener shrinkage in the bands of an undecimated wavelet transform, for noise whose strength follows the image."""

import cv2
import numpy as np

from asfm.frontend.denoising.noise_model import ImageNoise
from asfm.types import FloatArray, ImageArray

SPLINE: FloatArray = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16
"""The à trous algorithm's B3 spline (Starck and Murtagh 1994)."""
LEVELS = 2
"""In coarser bands the echoes of objects are stronger than speckle."""
NOISY_SIGMA_PX, CALM_SIGMA_PX = 3.0, 1.0
"""Over what a band's energy is averaged: the noisy image's, and that of the first estimate."""
ALONE = np.ones(1, dtype=np.float32)


def shrink_noise(image: ImageArray, echoes: ImageArray, noise: ImageNoise) -> ImageArray:
    """Take speckle and the background's fluctuation out of an image; the background's mean stays.

    Twice the same: each coefficient times signal / (signal + noise), the signal's local energy from the noisy
    coefficients first, from the result of that then (an empirical Wiener filter, Ghael et al. 1997). Without noise the
    image comes back as it is.

    Args:
        image: (ranges, beams) amplitudes.
        echoes: (ranges, beams) a first guess of the echoes without background.
        noise: of the image.
    """
    if noise.contrast == 0 and not noise.background_variance.any():
        return image.copy()
    gains = _noise_gains(noise.beam_correlation)
    variance = _predict_variance(echoes, noise)
    first = _shrink(image, None, variance, gains)
    return _shrink(image, first, _predict_variance(first - noise.floor, noise), gains)


def _predict_variance(echoes: ImageArray, noise: ImageNoise) -> ImageArray:
    return np.asarray(noise.background_variance + np.square(noise.contrast * np.maximum(echoes, 0)), dtype=np.float32)


def _shrink(image: ImageArray, pilot: ImageArray | None, variance: ImageArray, gains: FloatArray) -> ImageArray:
    result = np.zeros_like(image)
    for level in range(LEVELS):
        bands, image = _split(image, level)
        calm: list[ImageArray] | None = None
        if pilot is not None:
            calm, pilot = _split(pilot, level)
        for number, band in enumerate(bands):
            noise = np.float32(gains[level, number]) * variance
            source, sigma_px = (band, NOISY_SIGMA_PX) if calm is None else (calm[number], CALM_SIGMA_PX)
            energy = cv2.GaussianBlur(source * source, (0, 0), sigma_px * 1.4**level)
            signal = energy if calm is not None else np.maximum(energy - noise, 0)
            result += band * (signal / np.maximum(signal + noise, 1e-12))
    return np.asarray(result + image, dtype=np.float32)


def _split(image: ImageArray, level: int) -> tuple[list[ImageArray], ImageArray]:
    """Split an image into what is fine along both axes, along beams, along ranges, and the rest: their sum."""
    kernel = _spread_spline(level).astype(np.float32)  # sepFilter2D wants both of one type
    along_ranges = cv2.sepFilter2D(image, -1, ALONE, kernel)
    along_beams = cv2.sepFilter2D(image, -1, kernel, ALONE)
    rest = cv2.sepFilter2D(along_ranges, -1, kernel, ALONE)
    return [image - along_ranges - along_beams + rest, along_ranges - rest, along_beams - rest], rest


def _spread_spline(level: int) -> FloatArray:
    holed = np.zeros((len(SPLINE) - 1) * 2**level + 1)
    holed[:: 2**level] = SPLINE
    return holed


def _noise_gains(beam_correlation: float) -> FloatArray:
    """Give the share of the noise's variance in each band: (levels, 3), for noise correlated along the beams only.

    A lobe near a Gaussian correlates beams k apart by the k²-th power of the correlation of neighbours.
    """
    gains = np.empty((LEVELS, 3))
    before: FloatArray = np.ones(1)
    for level in range(LEVELS):
        low: FloatArray = np.convolve(before, _spread_spline(level))
        high: FloatArray = np.pad(before, (len(low) - len(before)) // 2) - low
        low_ranges, high_ranges = (_filter_variance(kernel, 0.0) for kernel in (low, high))
        low_beams, high_beams = (_filter_variance(kernel, beam_correlation) for kernel in (low, high))
        gains[level] = high_ranges * high_beams, low_ranges * high_beams, high_ranges * low_beams
        before = low
    return gains


def _filter_variance(kernel: FloatArray, correlation: float) -> float:
    lag = np.arange(1 - len(kernel), len(kernel))
    weight = np.where(lag == 0, 1.0, correlation ** (lag.astype(float) ** 2))
    return float(np.correlate(kernel, kernel, "full") @ weight)
