"""Sub-pixel refinement of corners detected on the levels of an image pyramid."""

import cv2
import numpy as np
from numpy.typing import NDArray

from asfm.types import FloatArray

WINDOW_PX = 7
"""Window of the structure tensor, in pixels of the pyramid level: that of ORB."""
HARRIS_K = 0.04
"""k of the Harris score det - k trace^2 of the structure tensor (Harris and Stephens 1988)."""
MIN_LEVEL_SIDE_PX = 5
"""Corners on smaller pyramid levels are not refined."""


def refine_subpixel(image: NDArray[np.uint8], xy_px: FloatArray, scale: FloatArray) -> FloatArray:
    """Move corners to the maximum of a parabola through the Harris score on their pyramid level.

    OpenCV scales the index of a pixel of the level, not its centre; the missing half pixel of the level is added first.

    Args:
        image: (height, width).
        xy_px: (K, 2) fractional column and row, pixel centres at +0.5.
        scale: (K,) pixels of the image per pixel of the pyramid level of each corner.

    Returns:
        (K, 2) refined positions, at most 1.5 pixels of the level from the centre of the pixel that the corner is in.
    """
    refined = xy_px + (scale[:, None] - 1) / 2
    image_size = np.array(image.shape[::-1])
    for level_scale in np.unique(scale):
        on_level = np.flatnonzero(scale == level_scale)
        size = np.maximum(np.round(image_size / level_scale).astype(int), 1)
        level = cv2.resize(image, tuple(size.tolist()), interpolation=cv2.INTER_LINEAR_EXACT)
        if min(level.shape) >= MIN_LEVEL_SIDE_PX:
            score = cv2.cornerHarris(level, WINDOW_PX, 3, HARRIS_K)
            refined[on_level] = _ascend(score, refined[on_level] * (size / image_size)) * (image_size / size)
    return refined


def _ascend(score: NDArray[np.float32], xy_px: FloatArray) -> FloatArray:
    """Move (K, 2) positions to the highest of 3 x 3 pixels, then to the maximum of the parabola along each axis."""
    height, width = score.shape
    column, row = np.clip(np.floor(xy_px).astype(int).T, 2, [[width - 3], [height - 3]])
    step_y, step_x = np.indices((3, 3)).reshape(2, 9) - 1
    highest = np.argmax(score[row[:, None] + step_y, column[:, None] + step_x], axis=1)
    column, row = column + step_x[highest], row + step_y[highest]
    return np.stack(
        [
            column + 0.5 + _parabola_maximum(score[row, column - 1], score[row, column], score[row, column + 1]),
            row + 0.5 + _parabola_maximum(score[row - 1, column], score[row, column], score[row + 1, column]),
        ],
        axis=1,
    )


def _parabola_maximum(
    before: NDArray[np.float32], here: NDArray[np.float32], after: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Return the maxima of parabolas through three neighbours, (K,) offsets in -0.5..0.5; 0 if not concave."""
    slope, curvature = 0.5 * (after.astype(float) - before), after.astype(float) - 2 * here.astype(float) + before
    concave = curvature < 0
    return np.clip(np.where(concave, -slope / np.where(concave, curvature, 1), 0), -0.5, 0.5)
