"""A clean image of the echoes: the mask, the background's mean taken off, the speckle calmed."""

import cv2
import numpy as np
from scipy.special import gamma, gammainc

from asfm.config import Config
from asfm.frontend.denoising.dbscan import dbscan_mask
from asfm.frontend.denoising.echo_mask import detect_echo_mask
from asfm.frontend.denoising.noise_model import ECHO_SIGMA_PX, ImageNoise, estimate_noise, smooth_echoes
from asfm.frontend.denoising.wavelet_shrinkage import shrink_noise
from asfm.types import BoolArray, FloatArray, Frame, ImageArray

LEAST_SIGMAS, LEAST_FACTOR = 5.0, 1.5
"""How far an echo stands out of the background's mean once the speckle is calmed: whichever is more."""
EDGE_PX = 1
FILL_PX = 31
DARKEST = 1e-12


def mask_image(frame: Frame, config: Config) -> ImageArray:
    """Set to zero what is outside the mask of CFAR and DBSCAN, as the paper does. (ranges, beams) in 0..1."""
    return np.where(detect_echo_mask(frame, config) & np.isfinite(frame.image), frame.image, np.float32(0))


def denoise_image(frame: Frame, config: Config) -> ImageArray:
    """Estimate the image without noise.

    CFAR compares a pixel with its surroundings and so loses the inside of wide echoes; here the mask also holds what
    stands out of the noise floor of the ping itself, cleaned by DBSCAN alike. Inside, speckle is shrunk in wavelet
    bands, the background's mean is taken off, and bright echoes get back what saturation cut from their speckle.
    Floor, correlation and contrast of the noise are estimated from the image: one without noise is left as it is.

    Returns:
        (ranges, beams) in 0..1, on the scale of ``frame.image``; zero where there is no data or no number.
    """
    amplitude = frame.amplitude
    valid = ~frame.invalid & np.isfinite(amplitude)
    image = _fill_gaps(amplitude, valid)
    noise = estimate_noise(image, valid)
    smooth = smooth_echoes(image)
    mask = dbscan_mask((smooth > _find_limit(noise)) & valid, config.clusters)
    mask = cv2.dilate(mask.view(np.uint8), np.ones((2 * EDGE_PX + 1, 2 * EDGE_PX + 1), np.uint8)).view(bool)
    mask = (mask | detect_echo_mask(frame, config)) & valid
    calm = shrink_noise(image, smooth - noise.floor, noise) - noise.floor
    cleaned = np.where(mask, _undo_saturation(np.clip(calm, 0, 1), noise.contrast), 0)
    return _rescale(np.asarray(cleaned, dtype=np.float32), mask, frame.decibel_span)


def _find_limit(noise: ImageNoise) -> ImageArray:
    """Give the value above which a smoothed pixel is an echo: (ranges, 1)."""
    sigma = np.sqrt(noise.background_variance) / (2 * np.sqrt(np.pi) * ECHO_SIGMA_PX)  # what a Gaussian leaves of it
    return np.asarray(np.maximum(noise.floor + LEAST_SIGMAS * sigma, LEAST_FACTOR * noise.floor), dtype=np.float32)


def _fill_gaps(image: ImageArray, valid: BoolArray) -> ImageArray:
    """Replace what is no data by the mean of the data around it, that it may not look like an echo or a shadow."""
    if valid.all():
        return image
    weight = valid.astype(np.float32)
    total, count = (cv2.blur(part, (FILL_PX, FILL_PX)) for part in (np.where(valid, image, np.float32(0)), weight))
    return np.where(valid, image, total / np.maximum(count, np.float32(1e-6)))


def _undo_saturation(image: ImageArray, contrast: float) -> ImageArray:
    """Invert the mean of min(s w, 1) over Weibull speckle w of mean 1, which is s P(p, (gamma(1 + p) / s)^(1 / p)).

    P is the regularised incomplete gamma function, and w the p-th power of an exponential variate over its mean.
    """
    if contrast == 0:
        return image
    powers = np.linspace(0.01, 1.0, 100)
    power = float(np.interp(contrast, np.sqrt(gamma(1 + 2 * powers) / gamma(1 + powers) ** 2 - 1), powers))
    true: FloatArray = np.linspace(0, 1, 129)
    seen = true * gammainc(power, (gamma(1 + power) / np.maximum(true, 1e-3)) ** (1 / power))
    return np.asarray(np.interp(image, seen, true), dtype=np.float32)


def _rescale(amplitude: ImageArray, mask: BoolArray, decibel_span: float | None) -> ImageArray:
    """Bring amplitudes back to the scale of the frame's image."""
    if decibel_span is None:
        return amplitude
    decibels = 20 * np.log10(np.maximum(amplitude, DARKEST))
    return np.asarray(np.where(mask, np.clip(1 + decibels / decibel_span, 0, 1), 0), dtype=np.float32)
