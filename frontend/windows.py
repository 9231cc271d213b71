"""Sums over rectangles around every pixel; what lies outside the image adds nothing."""

import cv2
import numpy as np
from asfm.types import BoolArray, FloatArray, ImageArray, IntArray


def sum_box(image: ImageArray, half_px: tuple[int, int]) -> FloatArray:
    """Sum a (R, B) image over the window of half-size (rows, columns) around each pixel. (R, B) in double precision."""
    size = _size(image.shape, half_px)
    return np.asarray(cv2.boxFilter(image, cv2.CV_64F, size, normalize=False, borderType=cv2.BORDER_CONSTANT))


def count_box(mask: BoolArray, half_px: tuple[int, int]) -> IntArray:
    """Count the true pixels of a (R, B) mask in the window of half-size (rows, columns) around each pixel. (R, B)."""
    bytes_, size = mask.view(np.uint8), _size(mask.shape, half_px)
    counts = cv2.boxFilter(bytes_, cv2.CV_32S, size, normalize=False, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(counts, dtype=np.int64)


def _size(shape: tuple[int, ...], half_px: tuple[int, int]) -> tuple[int, int]:
    """Full (width, height) in OpenCV's order; a window that outgrows the image sees no more by being larger still."""
    rows, columns = (min(half, length - 1) for half, length in zip(half_px, shape, strict=True))
    return 2 * columns + 1, 2 * rows + 1
