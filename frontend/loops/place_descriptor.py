"""Global place descriptor of a frame: mean amplitudes on a grid of range rings and bearing sectors.

Similar to Scan Context (Kim and Kim 2018). The similarity, a maximum over shifts of the grid, is invariant to gain, to
yaw (a shift in bearing) and to forward motion (a shift in range) while half of the grid overlaps. Sideways motion,
roll and another viewing direction change the descriptor. It rejects different places; it does not prove that two
frames show the same place.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray, Frame, IntArray

RINGS, SECTORS = 20, 32
MAX_SHIFT = (RINGS // 3, SECTORS // 2)
"""Largest shifts of the grid in either direction, in rings and sectors."""
MIN_OVERLAP = 0.5
"""Smallest share of the cells that overlap at a shift: small overlaps correlate by chance."""


def describe_place(frame: Frame, sonar: SonarModel) -> FloatArray:
    """Compute the place descriptor of a frame: mean amplitudes in rings and sectors of equal size.

    The square root of the amplitude limits the weight of the brightest echoes. The median of each ring is subtracted,
    since what fills a whole ring is noise of the water column or the sonar.

    Returns:
        (RINGS, SECTORS) means; NaN in cells without data.
    """
    row, column = (
        _cell_indices(edges, count)
        for edges, count in ((sonar.range_edges_m, RINGS), (sonar.bearing_edges_rad, SECTORS))
    )
    valid = ~frame.invalid
    amplitude = np.where(valid, np.sqrt(np.maximum(frame.amplitude, 0)), 0.0)
    sums, counts = (_sum_cells(np.asarray(values, dtype=float), row, column) for values in (amplitude, valid))
    with np.errstate(invalid="ignore"):
        mean = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    median = np.array([np.median(ring[np.isfinite(ring)]) if np.isfinite(ring).any() else 0.0 for ring in mean])
    return np.asarray(mean - median[:, None])


def place_similarity(first: FloatArray, second: FloatArray) -> float:
    """Compute the similarity of two place descriptors: their largest Pearson correlation over all shifts.

    The correlation at a shift is that of the overlapping cells with data in both.

    Args:
        first: (RINGS, SECTORS) descriptor, NaN where a cell has no data.
        second: (RINGS, SECTORS) descriptor.

    Returns:
        The similarity, 0..1; negative correlations count as 0.
    """
    best = 0.0
    present = [np.isfinite(side) for side in (first, second)]
    values = [np.where(known, side, 0.0) for side, known in zip((first, second), present, strict=True)]
    # Sums over the overlapping cells at all shifts at once are cross-correlations: products of Fourier transforms.
    known_a, a, aa = (_transform(part) for part in (present[0] * 1.0, values[0], values[0] ** 2))
    known_b, b, bb = (_transform(part) for part in (present[1] * 1.0, values[1], values[1] ** 2))
    pairs = ((known_a, known_b), (a, known_b), (known_a, b), (aa, known_b), (known_a, bb), (a, b))
    count, sum_a, sum_b, sum_aa, sum_bb, sum_ab = (_correlate(*pair) for pair in pairs)
    enough = count >= MIN_OVERLAP * RINGS * SECTORS
    if enough.any():
        n = np.maximum(count, 1.0)
        covariance = sum_ab - sum_a * sum_b / n
        variances = np.maximum(sum_aa - sum_a**2 / n, 0) * np.maximum(sum_bb - sum_b**2 / n, 0)
        floor = 1e-12 * max(float(variances.max()), 1e-300)
        correlation = np.where(enough & (variances > floor), covariance / np.sqrt(np.maximum(variances, floor)), 0.0)
        best = float(correlation.max())
    return min(max(best, 0.0), 1.0)


def _cell_indices(edges: FloatArray, count: int) -> IntArray:
    """Return the index (N,) of the cell, of count equal ones between the outer edges, of each pixel centre."""
    share = (0.5 * (edges[1:] + edges[:-1]) - edges[0]) / (edges[-1] - edges[0])
    return np.asarray(np.minimum((share * count).astype(np.int64), count - 1))


def _sum_cells(values: FloatArray, row: IntArray, column: IntArray) -> FloatArray:
    """Return the sums (RINGS, SECTORS) of pixel values in each cell."""
    return np.asarray(_membership(tuple(row), RINGS).T @ values @ _membership(tuple(column), SECTORS))


@lru_cache(maxsize=8)
def _membership(cells: tuple[int, ...], count: int) -> FloatArray:
    """Return the matrix (N, count) that is one where a row lies in a cell."""
    return np.asarray(np.array(cells)[:, None] == np.arange(count), dtype=float)


def _transform(values: FloatArray) -> NDArray[np.complex128]:
    """Return the Fourier transform of a (RINGS, SECTORS) grid, zero-padded to twice the size."""
    return np.fft.rfft2(values, (2 * RINGS, 2 * SECTORS))


def _correlate(first: NDArray[np.complex128], second: NDArray[np.complex128]) -> FloatArray:
    """Return the cross-correlation of two grids at all shifts, from their transforms."""
    rows, columns = (np.arange(-largest, largest + 1) for largest in MAX_SHIFT)
    return np.asarray(np.fft.irfft2(np.conj(first) * second, (2 * RINGS, 2 * SECTORS))[np.ix_(rows, columns)])
