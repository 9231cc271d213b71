"""Weibull clutter: estimation of the shape parameter from an image, and transformation to exponential noise.

Exponential noise power stays Weibull distributed under any power law: power has the shape 1, amplitude the shape 2
(Rayleigh), and the square root of amplitude, a common display compression, the shape 4. Raised to the power of its
shape the noise is exponential again.
"""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import gamma

from asfm.types import BoolArray, FloatArray

TILE_PX = 16
"""Side of the tiles in which contrast is measured: small enough for a constant noise level."""
MIN_TILE_SHARE = 0.125
"""Minimum share of usable pixels in a tile that is used."""
MIN_TILES = 12
SHAPE_LIMITS = (0.6, 8.0)
"""Smallest and largest shape; tiles whose contrast needs another one hold no noise."""
RAYLEIGH_SHAPE = 2.0
"""Default shape, of images too small or too uniform for an estimate."""
POWER_LIMITS = (1e-15, 1e10)
"""Smallest and largest power: larger echoes would make running sums lose the noise beside them to rounding, and smaller
ones would end up as subnormal numbers, which are slow."""

Image = NDArray[np.float32]


def transform_to_exponential(image: Image, usable: BoolArray) -> Image:
    """Raise an image of Weibull clutter to the power of its estimated shape: exponential noise of mean about 1.

    Args:
        image: (ranges, beams) finite pixels in any unit.
        usable: (ranges, beams) false for pixels to be ignored.

    Returns:
        (ranges, beams) power, 0 where not usable.
    """
    all_usable = bool(usable.all())
    scaled = np.maximum(image, np.float32(0))
    if not all_usable:
        scaled *= usable.view(np.uint8)
    scale = _estimate_scale(scaled, usable)
    if scale <= 0:
        return np.zeros(image.shape, dtype=np.float32)
    scaled *= np.float32(1 / scale)
    shape = estimate_weibull_shape(scaled, usable)
    lowest, highest = (np.float32(power ** (1 / shape)) for power in POWER_LIMITS)
    np.minimum(np.maximum(scaled, lowest, out=scaled), highest, out=scaled)
    power = cv2.pow(scaled, shape, dst=scaled)
    return np.asarray(power if all_usable else np.multiply(power, usable.view(np.uint8), out=power))


def _estimate_scale(image: Image, usable: BoolArray) -> float:
    """Compute the median of some thousand usable pixels, robust against echoes, or the mean of all if it is zero."""
    steps = tuple(slice(None, None, 1 + length // 64) for length in image.shape)
    sample = image[steps][usable[steps]]
    median = float(np.median(sample)) if sample.size else 0.0
    if median > 0:
        return median
    return float(image.sum(dtype=np.float64)) / max(int(np.count_nonzero(usable)), 1)


def estimate_weibull_shape(image: Image, usable: BoolArray) -> float:
    """Estimate the Weibull shape of the noise by the method of moments on the mode of the tile contrasts.

    The squared contrast of a tile, variance over squared mean, is gamma(1 + 2/shape) / gamma(1 + 1/shape)^2 - 1 if it
    holds noise alone, and varies from tile to tile with edges and echoes, so the mode is that of the noise.

    Args:
        image: (ranges, beams) non-negative pixels, 0 where not usable.
        usable: (ranges, beams) false for pixels to be ignored.

    Returns:
        The shape, within ``SHAPE_LIMITS``; ``RAYLEIGH_SHAPE`` if fewer than ``MIN_TILES`` tiles have the contrast of
        noise.
    """
    contrast = _squared_tile_contrast(image, usable)
    shapes = np.linspace(*SHAPE_LIMITS, 1000)[::-1]
    contrasts = gamma(1 + 2 / shapes) / gamma(1 + 1 / shapes) ** 2 - 1
    noise_contrast = contrast[(contrast > contrasts[0]) & (contrast < contrasts[-1])]
    if len(noise_contrast) < MIN_TILES:
        return RAYLEIGH_SHAPE
    return float(np.interp(_estimate_mode(noise_contrast), contrasts, shapes))


def _squared_tile_contrast(image: Image, usable: BoolArray) -> FloatArray:
    """Compute the squared contrast of each tile with enough usable pixels, corrected for small-sample bias: (T,)."""
    height, width = (min(TILE_PX, length) for length in image.shape)
    rows, columns = image.shape[0] // height, image.shape[1] // width
    part = (slice(0, rows * height), slice(0, columns * width))
    share_plane = np.ones((rows, columns)) if usable.all() else usable[part].astype(np.float32)
    planes = (share_plane, image[part], image[part] * image[part])
    averages = [cv2.resize(plane, (columns, rows), interpolation=cv2.INTER_AREA) for plane in planes]
    share, total, squares = (np.atleast_2d(average).astype(float).ravel() for average in averages)
    enough = (share * height * width >= max(MIN_TILE_SHARE * height * width, 2)) & (total > 0)
    share, total, squares = share[enough], total[enough], squares[enough]
    count, mean = share * height * width, total / share
    variance = np.maximum(squares / share - mean**2, 0) * count / (count - 1)
    squared_mean = np.maximum(mean**2 - variance / count, 1e-3 * mean**2)
    return np.asarray(variance / squared_mean)


def _estimate_mode(values: FloatArray) -> float:
    """Estimate the mode of (N,) values: half-sample mode (Bickel and Fruehwirth 2006), refined by a local mean.

    The window of the local mean follows from the spread below the mode, where echoes and edges add no tiles.
    """
    values = np.sort(values)
    densest = values
    while len(densest) > 3:
        half = (len(densest) + 1) // 2
        first = int(np.argmin(densest[half - 1 :] - densest[: len(densest) - half + 1]))
        densest = densest[first : first + half]
    mode = float(densest.mean())
    for _ in range(5):
        below = values[values <= mode]
        spread = float(np.sqrt(np.mean((below - mode) ** 2))) if len(below) else 0.0
        near = values[np.abs(values - mode) <= 2.5 * spread]
        if len(near) == 0:
            break
        mode = float(near.mean())
    return mode
