"""Image patches around keypoints."""

import numpy as np

from asfm.errors import AsfmError
from asfm.types import FloatArray, ImageArray, IntArray


def cut_patches(image: ImageArray, row_column: FloatArray, radius_px: int) -> ImageArray:
    """Cut a square patch centred on the pixel of each keypoint.

    The image is reflected about its outermost pixels beyond the border, repeatedly if needed. A keypoint outside the
    image gets the patch of the nearest pixel.

    Args:
        image: (height, width).
        row_column: (K, 2) fractional row and column, pixel centres at +0.5.
        radius_px: half-size r of the patches.

    Returns:
        (K, 2r+1, 2r+1) float32 copies.

    Raises:
        AsfmError: the image is empty or not two-dimensional, or a coordinate is not finite.
    """
    if image.ndim != 2 or image.size == 0:
        raise AsfmError(f"patches: expected a non-empty image (rows, columns), found the shape {image.shape}")
    if not np.isfinite(row_column).all():
        row = int(np.flatnonzero(~np.isfinite(row_column).all(axis=1))[0])
        raise AsfmError(f"patches: expected finite keypoint positions, found {row_column[row].tolist()} in row {row}")
    height, width = image.shape
    rows = _reflected_indices(row_column[:, 0], radius_px, height)
    columns = _reflected_indices(row_column[:, 1], radius_px, width)
    patches = image.ravel().take(rows[:, :, None] * width + columns[:, None, :])
    return np.asarray(patches, dtype=np.float32)


def crop_patches(patches: ImageArray, radius_px: int) -> ImageArray:
    """Crop (K, N, N) patches to their centres of radius r: (K, 2r+1, 2r+1), or unchanged where N is smaller."""
    margin = max((patches.shape[1] - 1) // 2 - radius_px, 0)
    return patches[:, margin : patches.shape[1] - margin, margin : patches.shape[2] - margin]


def _reflected_indices(coordinate: FloatArray, radius_px: int, length: int) -> IntArray:
    """Return (K, 2r+1) indices around the pixel of each (K,) coordinate on one axis, reflected into 0..length-1."""
    centre = np.floor(np.clip(coordinate, 0, length - 0.5)).astype(np.int64)
    index = centre[:, None] + np.arange(-radius_px, radius_px + 1)
    period = max(2 * (length - 1), 1)
    wrapped = np.abs(index) % period
    return np.asarray(np.minimum(wrapped, period - wrapped) if length > 1 else np.zeros_like(index))
