"""CFAR reference-cell sums and counts: box filters with a guard window.

The reference (training) cells of a cell under test are a rectangle without the guard cells, a smaller rectangle. Both
are centred on the cell and given by their half-sizes (rows, columns). Cells outside the image contribute nothing.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from asfm.types import BoolArray

HalfSize = tuple[int, int]

BLOCK_PIXELS = 32768
"""Pixels of the blocks in which OS-CFAR counts, small enough for the processor's cache."""

NumberArray = NDArray[Any]


def sum_reference_cells(image: NumberArray, reference_px: HalfSize, guard_px: HalfSize) -> NumberArray:
    """Sum an image over the reference cells of each pixel.

    Args:
        image: (ranges, beams) of float32, or of uint8 0 and 1 to count cells.
        reference_px: half-size (rows, columns) of the reference window.
        guard_px: half-size (rows, columns) of the guard window, not larger.

    Returns:
        (ranges, beams) of float64, or of int32 for a uint8 image.
    """
    outer, inner = (_sum_box(image, clip_half(half, image.shape)) for half in (reference_px, guard_px))
    return np.asarray(np.subtract(outer, inner, out=outer))


def sum_leading_lagging(
    image: NumberArray, reference_px: HalfSize, guard_px: HalfSize
) -> tuple[NumberArray, NumberArray]:
    """Sum an image over the leading (nearer) and the lagging (farther) reference cells of each pixel.

    Cells in the row of the cell under test belong to neither window. See :func:`sum_reference_cells` for the arguments.

    Returns:
        Two (ranges, beams) arrays, leading and lagging, of the type that :func:`sum_reference_cells` returns.
    """
    reference_px, guard_px = clip_half(reference_px, image.shape), clip_half(guard_px, image.shape)
    depth = reference_px[0]
    if depth == 0:
        zeros = np.zeros(image.shape, dtype=np.int32 if image.dtype == np.uint8 else np.float64)
        return zeros, zeros
    padded = cv2.copyMakeBorder(image, depth, depth + 1, 0, 0, cv2.BORDER_CONSTANT)
    outer = _sum_following_rows(padded, reference_px)
    leading, lagging = outer[: len(image)], outer[depth + 1 :][: len(image)]
    if guard_px[0] == 0:
        return leading, lagging
    inner = _sum_following_rows(padded, guard_px)
    return leading - inner[depth - guard_px[0] :][: len(image)], lagging - inner[depth + 1 :][: len(image)]


def count_reference_cells(mask: BoolArray, reference_px: HalfSize, guard_px: HalfSize) -> NDArray[np.intp]:
    """Count the true reference cells of each pixel of a (ranges, beams) mask: (ranges, beams).

    The same as :func:`sum_reference_cells` of the mask, in closed form if the mask is all true.
    """
    if not mask.all():
        return np.asarray(sum_reference_cells(as_counts(mask), reference_px, guard_px), dtype=np.intp)
    outer, inner = (
        np.outer(*(_count_along_axis(length, half, half) for length, half in zip(mask.shape, half_px, strict=True)))
        for half_px in (reference_px, guard_px)
    )
    return np.asarray(np.subtract(outer, inner, out=outer))


def count_leading_lagging(
    mask: BoolArray, reference_px: HalfSize, guard_px: HalfSize
) -> tuple[NumberArray, NumberArray]:
    """Count the true leading and lagging reference cells of each pixel of a (ranges, beams) mask: two (ranges, beams).

    The same as :func:`sum_leading_lagging` of the mask, in closed form if the mask is all true.
    """
    if not mask.all():
        return sum_leading_lagging(as_counts(mask), reference_px, guard_px)
    columns = [_count_along_axis(mask.shape[1], half[1], half[1]) for half in (reference_px, guard_px)]
    rows = [_count_along_axis(len(mask), half[0], -1) for half in (reference_px, guard_px)]
    outer, inner = (np.outer(*counts) for counts in zip(rows, columns, strict=True))
    leading = np.subtract(outer, inner, out=outer)
    return leading, leading[::-1]


def _count_along_axis(length: int, before: int, after: int) -> NDArray[np.intp]:
    """Count the pixels from i - before to i + after that lie on an axis, for each of its pixels i: (length,)."""
    index = np.arange(length)
    before, after = min(before, length), min(after, length)
    first, last = np.maximum(index - before, 0), np.minimum(index + after, length - 1)
    return np.asarray(np.maximum(last - first + 1, 0), dtype=np.intp)


def count_ring_below(
    image: NDArray[np.float32], limit: NDArray[np.float32], reference_px: HalfSize, guard_px: HalfSize
) -> NDArray[np.int32]:
    """Count the reference cells of each pixel that are below the limit of that pixel.

    Args:
        image: (ranges, beams), infinite where a pixel must never count.
        limit: (ranges, beams).
        reference_px: half-size (rows, columns) of the reference window.
        guard_px: half-size (rows, columns) of the guard window.

    Returns:
        (ranges, beams) of int32.
    """
    rows, columns = clip_half(reference_px, image.shape)
    offsets = [
        (row, column)
        for row in range(2 * rows + 1)
        for column in range(2 * columns + 1)
        if abs(row - rows) > guard_px[0] or abs(column - columns) > guard_px[1]
    ]
    padded = np.pad(image, ((rows, rows), (columns, columns)), constant_values=np.inf)
    counts = np.zeros(image.shape, dtype=np.int32)
    # Blocks of rows stay in the processor's cache, and up to 255 offsets can be counted in bytes.
    height = max(BLOCK_PIXELS // image.shape[1], 1)
    for start in range(0, len(image), height):
        block = limit[start : start + height]
        padded_block = padded[start : start + len(block) + 2 * rows]
        for first in range(0, len(offsets), 255):
            counts[start : start + height] += _count_below(padded_block, block, offsets[first : first + 255])
    return counts


def _count_below(
    padded: NDArray[np.float32], limit: NDArray[np.float32], offsets: list[tuple[int, int]]
) -> NDArray[np.uint8]:
    """Count, over at most 255 offsets (row, column), the shifted pixels below the (H, W) limit: (H, W)."""
    below = np.empty(limit.shape, dtype=bool)
    counts = np.zeros(limit.shape, dtype=np.uint8)
    for row, column in offsets:
        shifted = padded[row : row + limit.shape[0], column : column + limit.shape[1]]
        np.less(shifted, limit, out=below)
        np.add(counts, below.view(np.uint8), out=counts)
    return counts


def clip_half(half_px: HalfSize, shape: tuple[int, ...]) -> HalfSize:
    """Clip a half-size to that of a window that covers the image (ranges, beams) from every pixel."""
    return min(half_px[0], shape[0] - 1), min(half_px[1], shape[1] - 1)


def as_counts(mask: BoolArray) -> NDArray[np.uint8]:
    """View a mask as uint8 zeros and ones, without a copy if it is contiguous."""
    return np.ascontiguousarray(mask).view(np.uint8)


def _sum_box(image: NumberArray, half_px: HalfSize) -> NumberArray:
    size = (2 * half_px[1] + 1, 2 * half_px[0] + 1)
    return np.asarray(cv2.boxFilter(image, _sum_type(image), size, normalize=False, borderType=cv2.BORDER_CONSTANT))


def _sum_following_rows(image: NumberArray, half_px: HalfSize) -> NumberArray:
    """Sum over half_px[0] rows from each pixel's own row on, and over half_px[1] columns on either side."""
    size, anchor = (2 * half_px[1] + 1, half_px[0]), (half_px[1], 0)
    return np.asarray(
        cv2.boxFilter(image, _sum_type(image), size, anchor=anchor, normalize=False, borderType=cv2.BORDER_CONSTANT)
    )


def _sum_type(image: NumberArray) -> int:
    return cv2.CV_32S if image.dtype == np.uint8 else cv2.CV_64F
