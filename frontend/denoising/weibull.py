"""What the noise of an image is like: the shape of its Weibull distribution, estimated from the image itself.

Noise of exponential power stays Weibull distributed under any power law: amplitude has the shape 2 (Rayleigh), power
the shape 1, the square root of amplitude, as makers compress images for the screen, the shape 4. Raised to its shape,
noise is exponential again.
"""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import gamma

from asfm.types import BoolArray, FloatArray

TILE_PX = 16
"""Side of the tiles that contrast is measured in: the level of the noise hardly changes over so few pixels."""
MIN_TILE_SHARE = 0.125
"""Tiles with fewer usable pixels tell nothing."""
MIN_TILES = 12
SHAPES = (0.6, 8.0)
"""Shapes that are believed; tiles of another contrast hold no noise."""
RAYLEIGH = 2.0
"""Shape of an image too small or too even to tell its own."""
POWERS = (1e-15, 1e10)
"""Least and largest power: stronger echoes are cut, lest running sums lose the noise beside them to rounding, and
nothing is smaller, for numbers that end up near the least of all are slow to compute with."""

Image = NDArray[np.float32]


def transform_to_exponential(image: Image, usable: BoolArray) -> Image:
    """Raise an image of Weibull noise to the power that makes the noise exponential, of a mean near 1.

    Args:
        image: (ranges, beams) finite, in any unit.
        usable: (ranges, beams) false where a pixel tells nothing of the noise.

    Returns:
        (ranges, beams), 0 where not usable.
    """
    everywhere = bool(usable.all())
    scaled = np.maximum(image, np.float32(0))
    if not everywhere:
        scaled *= usable.view(np.uint8)
    typical = _find_typical(scaled, usable)
    if typical <= 0:
        return np.zeros(image.shape, dtype=np.float32)
    scaled *= np.float32(1 / typical)
    shape = estimate_weibull_shape(scaled, usable)
    least, largest = (np.float32(power ** (1 / shape)) for power in POWERS)
    np.minimum(np.maximum(scaled, least, out=scaled), largest, out=scaled)
    power = cv2.pow(scaled, shape, dst=scaled)
    return np.asarray(power if everywhere else np.multiply(power, usable.view(np.uint8), out=power))


def _find_typical(image: Image, usable: BoolArray) -> float:
    """Find the median of some thousand usable pixels, or the mean of all where it is zero: no echo sways the former."""
    steps = tuple(slice(None, None, 1 + length // 64) for length in image.shape)
    some = image[steps][usable[steps]]
    typical = float(np.median(some)) if some.size else 0.0
    if typical > 0:
        return typical
    return float(image.sum(dtype=np.float64)) / max(int(np.count_nonzero(usable)), 1)


def estimate_weibull_shape(image: Image, usable: BoolArray) -> float:
    """Estimate the shape of the noise: the commonest contrast of small tiles.

    The squared contrast of a tile, variance over squared mean, is gamma(1 + 2/shape) / gamma(1 + 1/shape)^2 - 1 where
    it holds noise alone, and larger where it holds an edge or an echo: noise is where the tiles agree.

    Args:
        image: (ranges, beams) 0 or more, 0 where not usable.
        usable: (ranges, beams) false where a pixel tells nothing of the noise.

    Returns:
        The shape, within ``SHAPES``; ``RAYLEIGH`` where fewer than ``MIN_TILES`` tiles look like noise.
    """
    contrast = _measure_contrast(image, usable)
    shapes = np.linspace(*SHAPES, 1000)[::-1]
    contrasts = gamma(1 + 2 / shapes) / gamma(1 + 1 / shapes) ** 2 - 1
    likely = contrast[(contrast > contrasts[0]) & (contrast < contrasts[-1])]
    if len(likely) < MIN_TILES:
        return RAYLEIGH
    return float(np.interp(_find_mode(likely), contrasts, shapes))


def _measure_contrast(image: Image, usable: BoolArray) -> FloatArray:
    """Squared contrast of each tile of enough usable pixels, without the bias of so few."""
    height, width = (min(TILE_PX, length) for length in image.shape)
    rows, columns = image.shape[0] // height, image.shape[1] // width
    part = (slice(0, rows * height), slice(0, columns * width))
    share_plane = np.ones((rows, columns)) if usable.all() else usable[part].astype(np.float32)
    planes = (share_plane, image[part], image[part] * image[part])
    averages = [cv2.resize(plane, (columns, rows), interpolation=cv2.INTER_AREA) for plane in planes]
    share, total, squares = (np.atleast_2d(average).astype(float).ravel() for average in averages)
    told = (share * height * width >= max(MIN_TILE_SHARE * height * width, 2)) & (total > 0)
    share, total, squares = share[told], total[told], squares[told]
    count, mean = share * height * width, total / share
    variance = np.maximum(squares / share - mean**2, 0) * count / (count - 1)
    squared_mean = np.maximum(mean**2 - variance / count, 1e-3 * mean**2)
    return np.asarray(variance / squared_mean)


def _find_mode(values: FloatArray) -> float:
    """Find where values crowd: from the half-sample mode (Bickel and Fruehwirth 2006) to the mean of its neighbours.

    How far the neighbours reach follows from the values below the mode, where no structure of the scene adds any.
    """
    values = np.sort(values)
    crowd = values
    while len(crowd) > 3:
        half = (len(crowd) + 1) // 2
        first = int(np.argmin(crowd[half - 1 :] - crowd[: len(crowd) - half + 1]))
        crowd = crowd[first : first + half]
    mode = float(crowd.mean())
    for _ in range(5):
        below = values[values <= mode]
        spread = float(np.sqrt(np.mean((below - mode) ** 2))) if len(below) else 0.0
        near = values[np.abs(values - mode) <= 2.5 * spread]
        if len(near) == 0:
            break
        mode = float(near.mean())
    return mode
