"""Intensity normalisation: Gaussian smoothing, scaling to a high quantile, and soft-knee compression."""

import cv2
import numpy as np

from asfm.config import KeypointsConfig
from asfm.types import ImageArray

BRIGHT_QUANTILE = 0.995
"""This quantile of the pixels is scaled to 1."""
KNEE = 0.6
"""Scaled intensities above this value are compressed."""


def normalise_intensity(image: ImageArray, settings: KeypointsConfig) -> ImageArray:
    """Smooth the speckle and normalise the gain, so that detection thresholds do not depend on it.

    Above the knee the scale approaches 1 without clipping: saturated plateaus would have no well-defined features.

    Args:
        image: (ranges, beams), finite and not empty.
        settings: smoothing_px is used.

    Returns:
        (ranges, beams) in 0..1.
    """
    bright = find_quantile(image, BRIGHT_QUANTILE)
    if bright <= 0:
        bright = float(image.max())
    scaled = cv2.GaussianBlur(image, (0, 0), settings.smoothing_px) if settings.smoothing_px > 0 else image.copy()
    scaled /= np.float32(bright if bright > 0 else 1)  # multiplying by the inverse of a subnormal would overflow
    np.maximum(scaled, 0, out=scaled)
    above_knee = np.flatnonzero(scaled > KNEE)
    excess, headroom = scaled.ravel()[above_knee] - np.float32(KNEE), np.float32(1 - KNEE)
    scaled.ravel()[above_knee] = KNEE + headroom * excess / (excess + headroom)
    return np.asarray(scaled, dtype=np.float32)


def find_quantile(image: ImageArray, quantile: float) -> float:
    """Compute a quantile, 0..1, of the pixels with linear interpolation.

    The same as ``numpy.quantile``, at a tenth of its time: one partition instead of several.
    """
    position = quantile * (image.size - 1)
    rank = int(position)
    ordered = np.partition(image, rank, axis=None)
    lower, rest = float(ordered[rank]), ordered[rank + 1 :]
    return lower + (position - rank) * (float(rest.min()) - lower) if rest.size else lower
