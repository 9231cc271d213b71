"""Sums over windows around every pixel; what lies outside the image adds nothing.

The windows are rings: a reference rectangle without the guard rectangle inside it, both centred on the pixel and given
by their half-sizes (rows, columns).
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from asfm.types import BoolArray

HalfSize = tuple[int, int]

BLOCK_PIXELS = 32768

NumberArray = NDArray[Any]


def sum_reference_cells(image: NumberArray, reference_px: HalfSize, guard_px: HalfSize) -> NumberArray:
    """Sum an image over the ring around each pixel.

    Args:
        image: (R, B) of float32, or of uint8 to be counted.
        reference_px: half-size of the outer rectangle.
        guard_px: half-size of the inner one, no larger.

    Returns:
        (R, B) of float64, or of int32 where the image is uint8.
    """
    outer, inner = (_sum_box(image, clip_half(half, image.shape)) for half in (reference_px, guard_px))
    return np.asarray(np.subtract(outer, inner, out=outer))


def sum_leading_lagging(
    image: NumberArray, reference_px: HalfSize, guard_px: HalfSize
) -> tuple[NumberArray, NumberArray]:
    """Sum an image over the rows of the ring before each pixel, and over those behind it.

    The pixel's own row belongs to neither half. Arguments and results (two of them) are those of
    :func:`sum_reference_cells`.
    """
    reference_px, guard_px = clip_half(reference_px, image.shape), clip_half(guard_px, image.shape)
    depth = reference_px[0]
    if depth == 0:
        nothing = np.zeros(image.shape, dtype=np.int32 if image.dtype == np.uint8 else np.float64)
        return nothing, nothing
    padded = cv2.copyMakeBorder(image, depth, depth + 1, 0, 0, cv2.BORDER_CONSTANT)
    outer = _sum_rows_ahead(padded, reference_px)
    before, behind = outer[: len(image)], outer[depth + 1 :][: len(image)]
    if guard_px[0] == 0:
        return before, behind
    inner = _sum_rows_ahead(padded, guard_px)
    return before - inner[depth - guard_px[0] :][: len(image)], behind - inner[depth + 1 :][: len(image)]


def count_reference_cells(mask: BoolArray, reference_px: HalfSize, guard_px: HalfSize) -> NDArray[np.intp]:
    """Count the mask's pixels around each pixel: :func:`sum_reference_cells`, at once if the mask is full."""
    if not mask.all():
        return np.asarray(sum_reference_cells(as_counts(mask), reference_px, guard_px), dtype=np.intp)
    outer, inner = (
        np.outer(*(_count_line(length, half, half) for length, half in zip(mask.shape, half_px, strict=True)))
        for half_px in (reference_px, guard_px)
    )
    return np.asarray(np.subtract(outer, inner, out=outer))


def count_leading_lagging(
    mask: BoolArray, reference_px: HalfSize, guard_px: HalfSize
) -> tuple[NumberArray, NumberArray]:
    """Count the mask's pixels before and behind: :func:`sum_leading_lagging`, at once if the mask is full."""
    if not mask.all():
        return sum_leading_lagging(as_counts(mask), reference_px, guard_px)
    columns = [_count_line(mask.shape[1], half[1], half[1]) for half in (reference_px, guard_px)]
    before = [_count_line(len(mask), half[0], -1) for half in (reference_px, guard_px)]
    outer, inner = (np.outer(*lines) for lines in zip(before, columns, strict=True))
    first = np.subtract(outer, inner, out=outer)
    return first, first[::-1]


def _count_line(length: int, before: int, behind: int) -> NDArray[np.intp]:
    """Count, for each of a line's pixels, those on the line from so many before it to so many behind it."""
    here = np.arange(length)
    before, behind = min(before, length), min(behind, length)
    first, last = np.maximum(here - before, 0), np.minimum(here + behind, length - 1)
    return np.asarray(np.maximum(last - first + 1, 0), dtype=np.intp)


def count_ring_below(
    image: NDArray[np.float32], limit: NDArray[np.float32], reference_px: HalfSize, guard_px: HalfSize
) -> NDArray[np.int32]:
    """Count the pixels of the ring that are smaller than the limit of the pixel in its middle.

    Args:
        image: (R, B), infinite where a pixel shall never count.
        limit: (R, B).
        reference_px: half-size of the outer rectangle.
        guard_px: half-size of the inner one.

    Returns:
        (R, B) of int32.
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
    # One shift of a block at a time, blocks small enough for the processor's cache, bytes as long as they can hold it.
    height = max(BLOCK_PIXELS // image.shape[1], 1)
    for start in range(0, len(image), height):
        block = limit[start : start + height]
        surroundings = padded[start : start + len(block) + 2 * rows]
        for first in range(0, len(offsets), 255):
            counts[start : start + height] += _count_below(surroundings, block, offsets[first : first + 255])
    return counts


def _count_below(
    surroundings: NDArray[np.float32], limit: NDArray[np.float32], offsets: list[tuple[int, int]]
) -> NDArray[np.uint8]:
    below = np.empty(limit.shape, dtype=bool)
    counts = np.zeros(limit.shape, dtype=np.uint8)
    for row, column in offsets:
        shifted = surroundings[row : row + limit.shape[0], column : column + limit.shape[1]]
        np.less(shifted, limit, out=below)
        np.add(counts, below.view(np.uint8), out=counts)
    return counts


def clip_half(half_px: HalfSize, shape: tuple[int, ...]) -> HalfSize:
    """Shrink a half-size to the image's: a window that outgrows the image sees no more by being larger still."""
    return min(half_px[0], shape[0] - 1), min(half_px[1], shape[1] - 1)


def as_counts(mask: BoolArray) -> NDArray[np.uint8]:
    """See a mask as zeros and ones, without a copy where it can be."""
    return np.ascontiguousarray(mask).view(np.uint8)


def _sum_box(image: NumberArray, half_px: HalfSize) -> NumberArray:
    size = (2 * half_px[1] + 1, 2 * half_px[0] + 1)
    return np.asarray(cv2.boxFilter(image, _sum_type(image), size, normalize=False, borderType=cv2.BORDER_CONSTANT))


def _sum_rows_ahead(image: NumberArray, half_px: HalfSize) -> NumberArray:
    """Sum from each pixel's row over as many rows as the half-size has, and over the columns to either side."""
    size, anchor = (2 * half_px[1] + 1, half_px[0]), (half_px[1], 0)
    return np.asarray(
        cv2.boxFilter(image, _sum_type(image), size, anchor=anchor, normalize=False, borderType=cv2.BORDER_CONSTANT)
    )


def _sum_type(image: NumberArray) -> int:
    return cv2.CV_32S if image.dtype == np.uint8 else cv2.CV_64F
