"""The picture in which features are looked for: of an even gain, calm, and not cut off where it is bright."""

import cv2
import numpy as np

from asfm.config import KeypointsConfig
from asfm.types import ImageArray

BRIGHT_SHARE = 0.995
"""The value that this share of the pixels does not exceed becomes 1."""
KNEE = 0.6
"""Echoes brighter than this share of the bright ones are compressed."""


def normalise_intensity(image: ImageArray, settings: KeypointsConfig) -> ImageArray:
    """Smooth the speckle and scale the brightest echoes towards 1, so that thresholds mean the same for every gain.

    Above the knee the scale bends and never ends: echoes cut off flat would have no place.

    Args:
        image: (ranges, beams), finite, with a pixel at least.
        settings: the smoothing is read.

    Returns:
        (ranges, beams) in 0..1.
    """
    brightest = find_quantile(image, BRIGHT_SHARE)
    if brightest <= 0:
        brightest = float(image.max())
    smooth = cv2.GaussianBlur(image, (0, 0), settings.smoothing_px) if settings.smoothing_px > 0 else image.copy()
    smooth /= np.float32(brightest if brightest > 0 else 1)  # the inverse of a faint one would overflow
    np.maximum(smooth, 0, out=smooth)
    bright = np.flatnonzero(smooth > KNEE)
    over, room = smooth.ravel()[bright] - np.float32(KNEE), np.float32(1 - KNEE)
    smooth.ravel()[bright] = KNEE + room * over / (over + room)
    return np.asarray(smooth, dtype=np.float32)


def find_quantile(image: ImageArray, share: float) -> float:
    """Find the value that a share of the pixels does not exceed, between two pixels' linearly.

    The same as NumPy's quantile, which picks several pixels by their rank at once and takes ten times as long.
    """
    place = share * (image.size - 1)
    rank = int(place)
    ordered = np.partition(image, rank, axis=None)
    below, beyond = float(ordered[rank]), ordered[rank + 1 :]
    return below + (place - rank) * (float(beyond.min()) - below) if beyond.size else below
