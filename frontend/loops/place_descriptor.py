"""Context: what a whole frame looks like, coarsely, to tell whether another one may show the same place.

A picture of rings of range and sectors of bearing. Compared over shifts, it does not change with the gain, with a turn
about the vertical (a shift along the bearings) or with a step ahead (a shift along the ranges), as long as half of it
stays in view. A step aside shears it, and roll and another direction of view change it: it rejects what is clearly
another place, and never proves that two are the same.
"""

from functools import lru_cache

import numpy as np

from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray, Frame, IntArray

RINGS, SECTORS = 20, 32
FARTHEST_SHIFT = (RINGS // 3, SECTORS // 2)
"""Shifts that are tried, in rings and sectors either way."""
LEAST_SHARE = 0.5
"""Share of the cells that must lie on each other at a shift, lest chance finds a corner that fits."""


def describe_place(frame: Frame, sonar: SonarModel) -> FloatArray:
    """Average the echoes' amplitude in rings and sectors, even in range and bearing.

    Square roots calm the brightest echoes; each ring loses its median, because what spreads over a whole ring is the
    water's or the sonar's own noise.

    Returns:
        (RINGS, SECTORS); NaN where a cell holds no data.
    """
    row, column = (
        _cells(edges, count) for edges, count in ((sonar.range_edges_m, RINGS), (sonar.bearing_edges_rad, SECTORS))
    )
    valid = ~frame.invalid
    amplitude = np.where(valid, np.sqrt(np.maximum(frame.amplitude, 0)), 0.0)
    sums, counts = (_sum_cells(np.asarray(values, dtype=float), row, column) for values in (amplitude, valid))
    with np.errstate(invalid="ignore"):
        mean = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    middle = np.array([np.median(ring[np.isfinite(ring)]) if np.isfinite(ring).any() else 0.0 for ring in mean])
    return np.asarray(mean - middle[:, None])


def place_similarity(first: FloatArray, second: FloatArray) -> float:
    """Give the likeness 0..1 of two descriptors: their largest correlation over the shifts, none below zero.

    The correlation is that of the cells on each other with data in both, about their own means.
    """
    best = 0.0
    present = [np.isfinite(side) for side in (first, second)]
    values = [np.where(known, side, 0.0) for side, known in zip((first, second), present, strict=True)]
    # All shifts at once: sums of products over the cells on each other are correlations, products of transforms.
    known_a, a, aa = (_transform(part) for part in (present[0] * 1.0, values[0], values[0] ** 2))
    known_b, b, bb = (_transform(part) for part in (present[1] * 1.0, values[1], values[1] ** 2))
    pairs = ((known_a, known_b), (a, known_b), (known_a, b), (aa, known_b), (known_a, bb), (a, b))
    count, sum_a, sum_b, sum_aa, sum_bb, sum_ab = (_correlate(*pair) for pair in pairs)
    enough = count >= LEAST_SHARE * RINGS * SECTORS
    if enough.any():
        n = np.maximum(count, 1.0)
        covariance = sum_ab - sum_a * sum_b / n
        spread = np.maximum(sum_aa - sum_a**2 / n, 0) * np.maximum(sum_bb - sum_b**2 / n, 0)
        floor = 1e-12 * max(float(spread.max()), 1e-300)
        likeness = np.where(enough & (spread > floor), covariance / np.sqrt(np.maximum(spread, floor)), 0.0)
        best = float(likeness.max())
    return min(max(best, 0.0), 1.0)


def _cells(edges: FloatArray, count: int) -> IntArray:
    """Tell in which of count even cells between the outer edges each pixel's centre lies."""
    share = (0.5 * (edges[1:] + edges[:-1]) - edges[0]) / (edges[-1] - edges[0])
    return np.asarray(np.minimum((share * count).astype(np.int64), count - 1))


def _sum_cells(values: FloatArray, row: IntArray, column: IntArray) -> FloatArray:
    return np.asarray(_membership(tuple(row), RINGS).T @ values @ _membership(tuple(column), SECTORS))


@lru_cache(maxsize=8)
def _membership(cells: tuple[int, ...], count: int) -> FloatArray:
    """(N, count) one where a row lies in a cell."""
    return np.asarray(np.array(cells)[:, None] == np.arange(count), dtype=float)


def _transform(values: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.complex128]]:
    return np.fft.rfft2(values, (2 * RINGS, 2 * SECTORS))


def _correlate(
    first: np.ndarray[tuple[int, ...], np.dtype[np.complex128]],
    second: np.ndarray[tuple[int, ...], np.dtype[np.complex128]],
) -> FloatArray:
    """Sum the products of two pictures at every shift that is tried."""
    rows, columns = (np.arange(-farthest, farthest + 1) for farthest in FARTHEST_SHIFT)
    return np.asarray(np.fft.irfft2(np.conj(first) * second, (2 * RINGS, 2 * SECTORS))[np.ix_(rows, columns)])
