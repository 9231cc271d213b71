"""Structural-and-spatial loss (SSL) between the patches of matched keypoints.

Structural term: (1 - SSIM) / 2, from the structural similarity of the two patches (Wang et al. 2004). Spatial term:
the distance between the vectors of column means, row means and mean of each patch. Both lie in 0..1; the loss is their
weighted sum.
"""

import threading

import cv2
import numpy as np
from numpy.typing import NDArray

from asfm.config import SslConfig
from asfm.errors import AsfmError
from asfm.types import FloatArray, ImageArray

WINDOW_PX = 7
"""Width of the windows of the structural similarity; smaller for patches smaller than this."""
CHUNK_PRODUCTS = 1 << 19
"""Products per chunk of patches: fits the cache, and is small enough for BLAS to stay on one thread."""
STABILISERS = (0.01**2, 0.03**2)
"""C1 and C2 of the structural similarity for values in 0..1."""

Patches = NDArray[np.floating]
Columns = NDArray[np.float32]


def structural_spatial_loss(patches_a: Patches, patches_b: Patches, config: SslConfig) -> FloatArray:
    """Compute the loss between the patches of matched keypoints; small for similar patches.

    Each patch is first stretched to 0..1 between its darkest and brightest pixel (a flat patch becomes zero), which
    makes the loss invariant to gain and offset. A term of weight zero is not computed.

    Args:
        patches_a: (M, 2r+1, 2r+1) patches of the first frame, finite, in any unit.
        patches_b: (M, 2r+1, 2r+1) patches of the second frame.
        config: weights of the two terms.

    Returns:
        (M,) structural_weight * structural term + spatial_weight * spatial term.

    Raises:
        AsfmError: the shapes differ or a pixel is not finite.
    """
    _check_shapes(patches_a, patches_b)
    with np.errstate(over="ignore", invalid="ignore"):
        loss = _compare(patches_a, patches_b, config, stretched=False)
    # A pixel that is not finite makes the loss so too, unless both terms are switched off.
    if not np.isfinite(loss).all() or config.structural_weight == config.spatial_weight == 0:
        _check_finite(patches_a, patches_b)
    return loss


def compare_stretched(stretched_a: ImageArray, stretched_b: ImageArray, config: SslConfig) -> FloatArray:
    """Compute the loss between patches already stretched by :func:`stretch_patches`, once per keypoint.

    Arguments and result are those of :func:`structural_spatial_loss`; the patches are not checked.
    """
    return _compare(stretched_a, stretched_b, config, stretched=True)


def stretch_patches(patches: Patches) -> ImageArray:
    """Stretch each of (M, N, N) patches to 0..1, a flat one to zero; return (M, N, N) float32."""
    flat = patches.reshape(len(patches), patches.shape[1] ** 2)
    stretched = (flat - flat.min(axis=1, keepdims=True)).astype(np.float32, copy=False)
    span = stretched.max(axis=1, keepdims=True)
    stretched /= np.where(span > 0, span, np.float32(1))
    return np.asarray(stretched.reshape(patches.shape))


class _Buffers(threading.local):
    """Work arrays of one thread, reused between calls: allocating them takes longer than the arithmetic."""

    def __init__(self) -> None:
        self.length, self.count = 0, 0

    def allocate(self, length: int, count: int) -> None:
        """Allocate the arrays for chunks of ``count`` patches with a side of ``length`` pixels."""
        if length == self.length and count <= self.count:
            return
        self.length, self.count, self.width = length, count, min(WINDOW_PX, length)
        offset = np.arange(length) - np.arange(length - self.width + 1)[:, None]
        self.band: FloatArray = np.asarray((offset >= 0) & (offset < self.width), dtype=float) / self.width
        windows = len(self.band)
        self.columns = np.empty((3, length**2 * count), dtype=np.float32)
        self.pixels = np.empty(2 * length**2 * count)
        self.half_averaged = np.empty(windows * length * count)
        self.means = np.empty(4 * windows**2 * count)


_BUFFERS = _Buffers()


def _compare(patches_a: Patches, patches_b: Patches, config: SslConfig, stretched: bool) -> FloatArray:
    loss = np.zeros(len(patches_a))
    length = patches_a.shape[-1]
    chunk = max(CHUNK_PRODUCTS // length**3, 1)
    _BUFFERS.allocate(length, min(chunk, len(loss)))
    for start in range(0, len(loss), chunk):
        part = slice(start, start + chunk)
        a, b, difference = _BUFFERS.columns[:, : length**2 * len(loss[part])].reshape(3, length**2, -1)
        a = _to_columns(patches_a[part], stretched, a)
        b = _to_columns(patches_b[part], stretched, b)
        np.subtract(a, b, out=difference)
        if config.structural_weight > 0:
            loss[part] += config.structural_weight * _structural_term(np.add(a, b, out=a), difference)
        if config.spatial_weight > 0:
            loss[part] += config.spatial_weight * _spatial_term(difference)
    return loss


def _to_columns(patches: Patches, stretched: bool, out: Columns) -> Columns:
    """Return (M, N, N) patches stretched and laid out as (N * N, M), with the matches along the last axis."""
    flat = patches.reshape(len(patches), -1)
    if flat.dtype != np.float32:
        flat = (flat - flat.min(axis=1, keepdims=True)).astype(np.float32)
    flat = np.ascontiguousarray(flat)
    columns: Columns = cv2.transpose(flat, dst=out).reshape(out.shape)
    if not stretched:
        low, high = (cv2.reduce(flat, 1, extreme).ravel() for extreme in (cv2.REDUCE_MIN, cv2.REDUCE_MAX))
        span = high - low
        columns -= low
        columns *= 1 / np.where(span > 0, span, np.float32(1))
    return columns


def _structural_term(total: Columns, difference: Columns) -> FloatArray:
    """Return the dissimilarities (1 - SSIM) / 2 (M,) of stretched patches a, b from (N * N, M) a + b and a - b.

    SSIM is the mean of (2 ab + C1) (2 cov + C2) / ((aa + bb + C1) (var_a + var_b + C2)) over all windows of 7 x 7
    pixels in the patch, where a and b are means. Its variances are unbiased; here C2 is divided by that factor instead.
    With s = a + b and d = a - b: 4 ab = ss - dd and 2 (aa + bb) = ss + dd, likewise for covariance and variances.
    """
    count = total.shape[1]
    sums, differences = _BUFFERS.means[: 4 * len(_BUFFERS.band) ** 2 * count].reshape(2, 2, -1, count)
    for means, columns in ((sums, total), (differences, difference)):
        pixels = _BUFFERS.pixels[: columns.size].reshape(columns.shape)
        pixels[:] = columns
        _average_windows(pixels, means[0])
        np.multiply(pixels, pixels, out=pixels)
        _average_windows(pixels, means[1])
        means[0] *= means[0]
        means[1] -= means[0]
    sums[0] += 2 * STABILISERS[0]
    sums[1] += 2 * STABILISERS[1] * (1 - 1 / max(_BUFFERS.width, 2) ** 2)
    numerator = _BUFFERS.pixels[: sums.size].reshape(sums.shape)
    np.subtract(sums, differences, out=numerator)
    sums += differences
    similarity = np.multiply(numerator[0], numerator[1], out=numerator[0])
    similarity /= np.multiply(sums[0], sums[1], out=sums[0])
    return np.asarray(np.clip(0.5 - 0.5 * similarity.mean(axis=0), 0.0, 1.0))


def _average_windows(pixels: FloatArray, out: FloatArray) -> None:
    """Write the means (windows * windows, M) of (N * N, M) pixels over every window to ``out``.

    The box filter is separable: two products with a band matrix, along columns and along rows.
    """
    count, (windows, length) = pixels.shape[1], _BUFFERS.band.shape
    half_averaged = _BUFFERS.half_averaged[: windows * length * count].reshape(windows, length * count)
    np.matmul(_BUFFERS.band, pixels.reshape(length, length * count), out=half_averaged)
    np.matmul(_BUFFERS.band, half_averaged.reshape(windows, length, count), out=out.reshape(windows, windows, count))


def _spatial_term(difference: Columns) -> FloatArray:
    """Return the spatial distances (M,) in 0..1 of stretched patches a, b from (N * N, M) a - b.

    The Euclidean distance of the vectors (N column means, N row means, overall mean) is divided by its largest value,
    sqrt(2 N + 1).
    """
    length = round(len(difference) ** 0.5)
    patches = difference.reshape(length, length, -1)
    columns, rows = patches.mean(axis=0), patches.mean(axis=1)
    squared = (columns * columns).sum(axis=0) + (rows * rows).sum(axis=0) + columns.mean(axis=0) ** 2
    return np.asarray(np.sqrt(squared / (2 * length + 1)), dtype=np.float64)


def _check_shapes(patches_a: Patches, patches_b: Patches) -> None:
    shape = patches_a.shape
    if shape != patches_b.shape or len(shape) != 3 or shape[1] != shape[2] or shape[1] == 0:
        raise AsfmError(
            "structural-and-spatial loss: expected two equal stacks of square patches, "
            f"found {shape} and {patches_b.shape}"
        )


def _check_finite(patches_a: Patches, patches_b: Patches) -> None:
    for name, patches in (("first", patches_a), ("second", patches_b)):
        # The loss is computed in single precision, where large values overflow.
        with np.errstate(over="ignore"):
            finite = np.isfinite(patches.astype(np.float32)).all(axis=(1, 2))
        if not finite.all():
            bad = int(np.flatnonzero(~finite)[0])
            raise AsfmError(
                f"structural-and-spatial loss: expected finite pixels, found others in patch {bad} of the {name} frame"
            )
