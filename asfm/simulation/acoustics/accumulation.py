"""Accumulation of echoes in the pixels: received power, and ground truth of the elevation."""

import numpy as np

from asfm.simulation.acoustics.echoes import Echoes
from asfm.types import FloatArray, ImageArray

SAME_SURFACE_RAD = np.deg2rad(1.0)
"""Largest difference in elevation between echoes that are averaged."""


def accumulate_power(echoes: Echoes, shape: tuple[int, int]) -> ImageArray:
    """Sum the power of echoes in each pixel, each echo linearly divided between the two nearest rows.

    Args:
        echoes: their rows, beams and powers.
        shape: (beams, ranges)

    Returns:
        (beams, ranges) power, before the receiver's point spread and noise.
    """
    beams, rows = shape
    position = echoes.row + np.float32(0.5)
    np.clip(position, 0, rows + 1, out=position)
    pixel = position.astype(np.intp)
    position -= np.trunc(position)
    position *= echoes.power
    padded = rows + 2  # one row of padding on either side takes the echoes out of range
    pixel += echoes.column * padded
    both = np.bincount(pixel, echoes.power, beams * padded).reshape(beams, padded)
    far = np.bincount(pixel, position, beams * padded).reshape(beams, padded)
    both -= far
    both[:, 1:] += far[:, :-1]
    return both[:, 1:-1].astype(np.float32)


def average_elevation(echoes: Echoes, shape: tuple[int, int]) -> FloatArray:
    """Return the elevation of each pixel's strongest surface.

    Where several surfaces fall into one pixel (layover), the mean over all of them would be a place without a surface.
    The mean, weighted by power, is therefore over the echoes within one degree of the strongest.

    Args:
        echoes: their rows, beams, powers and elevations.
        shape: (ranges, beams)

    Returns:
        (ranges, beams) elevation in radians, NaN where nothing echoes.
    """
    rows, columns = shape
    position = np.clip(echoes.row + np.float32(0.5), 0, rows + 1)
    upper = position.astype(np.int64)
    flat = upper * columns + echoes.column
    pixel = np.concatenate([flat, flat + columns])
    power = np.concatenate([echoes.power * (1 - position + upper), echoes.power * (position - upper)]).astype(float)
    elevation = np.tile(echoes.elevation_rad.astype(float), 2)
    size = (rows + 3) * columns
    greatest = np.zeros(size)
    np.maximum.at(greatest, pixel, power)
    leading = power == greatest[pixel]
    strongest = np.zeros(size)
    strongest[pixel[leading]] = elevation[leading]
    mean: FloatArray = strongest
    for _ in range(2):  # around the strongest, which may be at the edge of its surface, then around the mean there
        near = np.abs(elevation - mean[pixel]) <= SAME_SURFACE_RAD
        weight = np.bincount(pixel[near], power[near], size)
        total = np.bincount(pixel[near], (power * elevation)[near], size)
        mean = np.divide(total, weight, out=np.full(size, np.nan), where=weight > 0)
    return mean.reshape(-1, columns)[1 : rows + 1]
