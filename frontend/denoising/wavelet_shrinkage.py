"""Wavelet shrinkage: empirical Wiener filter on an undecimated transform, for signal-dependent noise."""

import cv2
import numpy as np

from asfm.frontend.denoising.noise_model import ImageNoise
from asfm.types import FloatArray, ImageArray

SPLINE: FloatArray = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16
"""The à trous algorithm's B3 spline (Starck and Murtagh 1994)."""
LEVELS = 2
"""Decomposition levels; in coarser bands the echoes of objects are stronger than speckle."""
NOISY_SIGMA_PX, PILOT_SIGMA_PX = 3.0, 1.0
"""Gaussian window over which the energy of a band is averaged: of the noisy image, and of the pilot estimate."""
IDENTITY_KERNEL = np.ones(1, dtype=np.float32)


def shrink_noise(image: ImageArray, echoes: ImageArray, noise: ImageNoise) -> ImageArray:
    """Reduce the speckle and the background fluctuation of an image; the mean of the background stays.

    Two passes multiply each coefficient by signal / (signal + noise). The local signal energy comes from the noisy
    coefficients in the first pass and from its result, the pilot, in the second one (empirical Wiener filter, Ghael et
    al. 1997).

    Args:
        image: (ranges, beams) amplitudes.
        echoes: (ranges, beams) first estimate of the echoes without background.
        noise: noise of the image.

    Returns:
        (ranges, beams) amplitudes; a copy of the image if it has no noise.
    """
    if noise.contrast == 0 and not noise.background_variance.any():
        return image.copy()
    gains = _band_noise_gains(noise.beam_correlation)
    variance = _noise_variance(echoes, noise)
    pilot = _shrink_bands(image, None, variance, gains)
    return _shrink_bands(image, pilot, _noise_variance(pilot - noise.floor, noise), gains)


def _noise_variance(echoes: ImageArray, noise: ImageNoise) -> ImageArray:
    """Compute the noise variance of each pixel, background plus speckle: (ranges, beams)."""
    return np.asarray(noise.background_variance + np.square(noise.contrast * np.maximum(echoes, 0)), dtype=np.float32)


def _shrink_bands(image: ImageArray, pilot: ImageArray | None, variance: ImageArray, gains: FloatArray) -> ImageArray:
    """Shrink the coefficients of all bands; the signal energy comes from the pilot, or from the image without one."""
    result = np.zeros_like(image)
    for level in range(LEVELS):
        bands, image = _decompose(image, level)
        pilot_bands: list[ImageArray] | None = None
        if pilot is not None:
            pilot_bands, pilot = _decompose(pilot, level)
        for number, band in enumerate(bands):
            noise = np.float32(gains[level, number]) * variance
            source, sigma_px = (band, NOISY_SIGMA_PX) if pilot_bands is None else (pilot_bands[number], PILOT_SIGMA_PX)
            energy = cv2.GaussianBlur(source * source, (0, 0), sigma_px * 1.4**level)
            signal = energy if pilot_bands is not None else np.maximum(energy - noise, 0)
            result += band * (signal / np.maximum(signal + noise, 1e-12))
    return np.asarray(result + image, dtype=np.float32)


def _decompose(image: ImageArray, level: int) -> tuple[list[ImageArray], ImageArray]:
    """Decompose an image into three detail bands and the approximation, all (ranges, beams), which sum to the image.

    The detail bands are high-pass along both axes, along beams, and along ranges.
    """
    kernel = _dilated_spline(level).astype(np.float32)  # sepFilter2D wants both kernels of one type
    along_ranges = cv2.sepFilter2D(image, -1, IDENTITY_KERNEL, kernel)
    along_beams = cv2.sepFilter2D(image, -1, kernel, IDENTITY_KERNEL)
    approximation = cv2.sepFilter2D(along_ranges, -1, kernel, IDENTITY_KERNEL)
    details = [
        image - along_ranges - along_beams + approximation,
        along_ranges - approximation,
        along_beams - approximation,
    ]
    return details, approximation


def _dilated_spline(level: int) -> FloatArray:
    """Return the spline with 2**level - 1 zeros between its taps."""
    dilated = np.zeros((len(SPLINE) - 1) * 2**level + 1)
    dilated[:: 2**level] = SPLINE
    return dilated


def _band_noise_gains(beam_correlation: float) -> FloatArray:
    """Compute the share of the noise variance in each detail band, (LEVELS, 3), for noise correlated along beams.

    With a nearly Gaussian beam pattern, beams k apart are correlated by the k²-th power of the correlation of
    neighbours.
    """
    gains = np.empty((LEVELS, 3))
    before: FloatArray = np.ones(1)
    for level in range(LEVELS):
        low: FloatArray = np.convolve(before, _dilated_spline(level))
        high: FloatArray = np.pad(before, (len(low) - len(before)) // 2) - low
        low_ranges, high_ranges = (_filter_variance(kernel, 0.0) for kernel in (low, high))
        low_beams, high_beams = (_filter_variance(kernel, beam_correlation) for kernel in (low, high))
        gains[level] = high_ranges * high_beams, low_ranges * high_beams, high_ranges * low_beams
        before = low
    return gains


def _filter_variance(kernel: FloatArray, correlation: float) -> float:
    """Compute the output variance of a filter for unit-variance noise with the given correlation of neighbours."""
    lag = np.arange(1 - len(kernel), len(kernel))
    weight = np.where(lag == 0, 1.0, correlation ** (lag.astype(float) ** 2))
    return float(np.correlate(kernel, kernel, "full") @ weight)
