"""Sonar image denoising: echo mask, background subtraction and wavelet shrinkage of speckle."""

import cv2
import numpy as np
from scipy.special import gamma, gammainc

from asfm.config import Config
from asfm.frontend.denoising.dbscan import dbscan_mask
from asfm.frontend.denoising.echo_mask import detect_echo_mask
from asfm.frontend.denoising.noise_model import ECHO_SIGMA_PX, ImageNoise, estimate_noise, smooth_echoes
from asfm.frontend.denoising.wavelet_shrinkage import shrink_noise
from asfm.types import BoolArray, FloatArray, Frame, ImageArray

MIN_ECHO_SIGMAS, MIN_ECHO_FACTOR = 5.0, 1.5
"""An echo in the smoothed image exceeds the floor by this number of standard deviations and by this factor."""
MASK_MARGIN_PX = 1
FILL_WINDOW_PX = 31
MIN_AMPLITUDE = 1e-12


def mask_image(frame: Frame, config: Config) -> ImageArray:
    """Set the pixels outside the echo mask to zero, as in the paper: (ranges, beams) in 0..1."""
    return np.where(detect_echo_mask(frame, config) & np.isfinite(frame.image), frame.image, np.float32(0))


def denoise_image(frame: Frame, config: Config) -> ImageArray:
    """Estimate the noise-free image of a frame.

    CFAR compares a pixel with its surroundings and so loses the interior of wide echoes. The mask here also holds the
    pixels above the noise floor of the ping, cleaned by DBSCAN too. Inside the mask speckle is reduced by wavelet
    shrinkage, the mean of the background is subtracted, and the bias of saturated speckle is corrected. All noise
    parameters are estimated from the image; an image without noise is returned unchanged.

    Args:
        frame: image (ranges, beams) with its invalid pixels.
        config: sections ``cfar`` and ``clusters``, and ``keypoints.margin_px``.

    Returns:
        (ranges, beams) in 0..1, on the scale of ``frame.image``; zero where a pixel is invalid or not finite.
    """
    amplitude = frame.amplitude
    valid = ~frame.invalid & np.isfinite(amplitude)
    image = _fill_gaps(amplitude, valid)
    noise = estimate_noise(image, valid)
    smooth = smooth_echoes(image)
    mask = dbscan_mask((smooth > _echo_threshold(noise)) & valid, config.clusters)
    kernel = np.ones((2 * MASK_MARGIN_PX + 1, 2 * MASK_MARGIN_PX + 1), np.uint8)
    mask = cv2.dilate(mask.view(np.uint8), kernel).view(bool)
    mask = (mask | detect_echo_mask(frame, config)) & valid
    echoes = shrink_noise(image, smooth - noise.floor, noise) - noise.floor
    denoised = np.where(mask, _correct_saturation(np.clip(echoes, 0, 1), noise.contrast), 0)
    return _rescale(np.asarray(denoised, dtype=np.float32), mask, frame.decibel_span)


def _echo_threshold(noise: ImageNoise) -> ImageArray:
    """Compute the threshold above which a pixel of the smoothed image is an echo: (ranges, 1)."""
    # Standard deviation of white noise after a Gaussian filter.
    sigma = np.sqrt(noise.background_variance) / (2 * np.sqrt(np.pi) * ECHO_SIGMA_PX)
    threshold = np.maximum(noise.floor + MIN_ECHO_SIGMAS * sigma, MIN_ECHO_FACTOR * noise.floor)
    return np.asarray(threshold, dtype=np.float32)


def _fill_gaps(image: ImageArray, valid: BoolArray) -> ImageArray:
    """Replace invalid pixels by the mean of the valid ones around them, so that they are neither echo nor shadow."""
    if valid.all():
        return image
    window, weight = (FILL_WINDOW_PX, FILL_WINDOW_PX), valid.astype(np.float32)
    total, count = (cv2.blur(part, window) for part in (np.where(valid, image, np.float32(0)), weight))
    return np.where(valid, image, total / np.maximum(count, np.float32(1e-6)))


def _correct_saturation(image: ImageArray, contrast: float) -> ImageArray:
    """Correct the mean of saturated speckle of a given contrast: amplitudes (ranges, beams) to true ones.

    Inverts E[min(s w, 1)] = s P(p, (gamma(1 + p) / s)^(1 / p)) for Weibull speckle w of mean 1, the p-th power of an
    exponential variate over its mean. P is the regularised incomplete gamma function.
    """
    if contrast == 0:
        return image
    powers = np.linspace(0.01, 1.0, 100)
    power = float(np.interp(contrast, np.sqrt(gamma(1 + 2 * powers) / gamma(1 + powers) ** 2 - 1), powers))
    true: FloatArray = np.linspace(0, 1, 129)
    saturated = true * gammainc(power, (gamma(1 + power) / np.maximum(true, 1e-3)) ** (1 / power))
    return np.asarray(np.interp(image, saturated, true), dtype=np.float32)


def _rescale(amplitude: ImageArray, mask: BoolArray, decibel_span: float | None) -> ImageArray:
    """Convert amplitudes to the scale of the frame's image: decibels over the span, or unchanged if linear."""
    if decibel_span is None:
        return amplitude
    decibels = 20 * np.log10(np.maximum(amplitude, MIN_AMPLITUDE))
    return np.asarray(np.where(mask, np.clip(1 + decibels / decibel_span, 0, 1), 0), dtype=np.float32)
