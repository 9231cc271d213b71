"""Squares of the image around keypoints."""

import numpy as np

from asfm.errors import AsfmError
from asfm.types import FloatArray, ImageArray, IntArray


def cut_patches(image: ImageArray, row_column: FloatArray, radius_px: int) -> ImageArray:
    """Cut the patch around the pixel that holds each keypoint.

    Beyond the border the image goes on mirrored about its outermost pixels, as often as it takes. A keypoint outside
    the image takes the nearest pixel's patch.

    Args:
        image: (H, W).
        row_column: (K, 2) fractional row and column, pixel centres at +0.5.
        radius_px: half-size r of the patches.

    Returns:
        (K, 2r+1, 2r+1) float32 copies.

    Raises:
        AsfmError: the image is empty or a coordinate is not finite.
    """
    if image.ndim != 2 or image.size == 0:
        raise AsfmError(f"patches: expected an image (rows, columns), found the shape {image.shape}")
    if not np.isfinite(row_column).all():
        row = int(np.flatnonzero(~np.isfinite(row_column).all(axis=1))[0])
        raise AsfmError(f"patches: expected finite keypoints, found {row_column[row].tolist()} in row {row}")
    height, width = image.shape
    rows = _mirrored_range(row_column[:, 0], radius_px, height)
    columns = _mirrored_range(row_column[:, 1], radius_px, width)
    patches = image.ravel().take(rows[:, :, None] * width + columns[:, None, :])
    return np.asarray(patches, dtype=np.float32)


def crop_patches(patches: ImageArray, radius_px: int) -> ImageArray:
    """Give the middle of (K, N, N) patches: (K, 2r+1, 2r+1); all of it where the patches are smaller."""
    margin = max((patches.shape[1] - 1) // 2 - radius_px, 0)
    return patches[:, margin : patches.shape[1] - margin, margin : patches.shape[2] - margin]


def _mirrored_range(coordinate: FloatArray, radius_px: int, length: int) -> IntArray:
    """(K, 2r+1) indices around each coordinate's pixel along one axis, folded back into 0..length-1."""
    centre = np.floor(np.clip(coordinate, 0, length - 0.5)).astype(np.int64)
    index = centre[:, None] + np.arange(-radius_px, radius_px + 1)
    period = max(2 * (length - 1), 1)
    folded = np.abs(index) % period
    return np.asarray(np.minimum(folded, period - folded) if length > 1 else np.zeros_like(index))
