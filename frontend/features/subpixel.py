"""Places between the pixels for corners that a detector found on the pixels of an image pyramid."""

import cv2
import numpy as np
from numpy.typing import NDArray

from asfm.types import FloatArray

WINDOW_PX = 7
"""Width of the window over which Harris's structure is summed, in pixels of the pyramid's level: that of ORB."""
HARRIS = 0.04
"""Harris's k: the score is det - k trace^2 of the structure (Harris and Stephens 1988)."""


def refine_subpixel(picture: NDArray[np.uint8], xy_px: FloatArray, scale: FloatArray) -> FloatArray:
    """Move corners to the top of the parabola through Harris's score around them, on their level of the pyramid.

    OpenCV scales the number of a level's pixel up, and not the place of its centre: that half pixel of the level is
    added first.

    Args:
        picture: (height, width).
        xy_px: (K, 2) fractional column and row, pixel centres at +0.5.
        scale: (K,) pixels of the picture in one pixel of each corner's level.

    Returns:
        (K, 2), at most one and a half pixels of its level away from where the corner was.
    """
    refined = xy_px + (scale[:, None] - 1) / 2
    whole = np.array(picture.shape[::-1])
    for level in np.unique(scale):
        chosen = np.flatnonzero(scale == level)
        size = np.maximum(np.round(whole / level).astype(int), 1)
        smaller = cv2.resize(picture, tuple(size.tolist()), interpolation=cv2.INTER_LINEAR_EXACT)
        if min(smaller.shape) >= 5:
            score = cv2.cornerHarris(smaller, WINDOW_PX, 3, HARRIS)
            refined[chosen] = _ascend(score, refined[chosen] * (size / whole)) * (whole / size)
    return refined


def _ascend(score: NDArray[np.float32], xy_px: FloatArray) -> FloatArray:
    """Step to the highest of the nine pixels, then to the top of the parabola along each axis."""
    height, width = score.shape
    column, row = np.clip(np.floor(xy_px).astype(int).T, 2, [[width - 3], [height - 3]])
    step_y, step_x = np.indices((3, 3)).reshape(2, 9) - 1
    highest = np.argmax(score[row[:, None] + step_y, column[:, None] + step_x], axis=1)
    column, row = column + step_x[highest], row + step_y[highest]
    return np.stack(
        [
            column + 0.5 + _parabola_top(score[row, column - 1], score[row, column], score[row, column + 1]),
            row + 0.5 + _parabola_top(score[row - 1, column], score[row, column], score[row + 1, column]),
        ],
        axis=1,
    )


def _parabola_top(
    before: NDArray[np.float32], here: NDArray[np.float32], after: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Give the top, within half a pixel, of the parabola through three neighbours; 0 where there is none."""
    slope, bend = 0.5 * (after.astype(float) - before), after.astype(float) - 2 * here.astype(float) + before
    downward = bend < 0
    return np.clip(np.where(downward, -slope / np.where(downward, bend, 1), 0), -0.5, 0.5)
