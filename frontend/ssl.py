"""The structural-and-spatial loss: do two keypoints' surroundings look alike?

Structural: one minus the structural similarity of the two squares (Wang et al. 2004). Spatial: the distance of the
vectors (mean of each column, mean of each row, mean of the square). Both lie in 0..1 and add up with their weights.
"""

import numpy as np
from numpy.typing import NDArray

from asfm.config import SslConfig
from asfm.errors import AsfmError
from asfm.types import FloatArray, ImageArray

WINDOW_PX = 7
"""Width of the windows whose similarities are averaged (less where the square is smaller)."""
CHUNK_PRODUCTS = 1 << 19
"""Products of one step: as many matches at once as fit the cache, few enough for BLAS to stay on one thread."""
STABILISERS = (0.01**2, 0.03**2)
"""C1 and C2 of the structural similarity for values in 0..1."""

Patches = NDArray[np.floating]


def structural_spatial_loss(patches_a: Patches, patches_b: Patches, config: SslConfig) -> FloatArray:
    """Compare the squares around matched keypoints; small where they look alike.

    Each square is first stretched to 0..1 by its own darkest and brightest pixel (a flat square becomes all zero), so
    gain and offset do not matter. A term of weight zero is not computed.

    Args:
        patches_a: (M, 2r+1, 2r+1) squares of the first frame, finite, in any unit.
        patches_b: (M, 2r+1, 2r+1) squares of the second frame.
        config: weights of the two terms.

    Returns:
        (M,) structural_weight * structural term + spatial_weight * spatial term.

    Raises:
        AsfmError: the shapes disagree or a pixel is not finite.
    """
    _check(patches_a, patches_b)
    loss = np.zeros(len(patches_a))
    length = patches_a.shape[-1]
    chunk = max(CHUNK_PRODUCTS // length**3, 1)
    memory = np.empty(4 * length**2 * min(chunk, len(loss)))
    for start in range(0, len(loss), chunk):
        part = slice(start, start + chunk)
        count = len(loss[part])
        planes = memory[: 4 * length**2 * count].reshape(4, length, length, count)
        for plane, patches in zip(planes, (patches_a, patches_b), strict=False):
            plane[:] = np.moveaxis(stretch_patches(patches[part]), 0, 2)
        if config.structural_weight > 0:
            loss[part] += config.structural_weight * _structural_term(planes)
        if config.spatial_weight > 0:
            loss[part] += config.spatial_weight * _spatial_term(planes[0], planes[1])
    return loss


def stretch_patches(patches: Patches) -> ImageArray:
    """Stretch each of (M, N, N) squares to 0..1; a flat one becomes zero."""
    flat = patches.reshape(len(patches), -1)
    low = flat.min(axis=1, keepdims=True)
    span = (flat.max(axis=1, keepdims=True) - low).astype(np.float32)
    stretched = (flat - low).astype(np.float32, copy=False)
    stretched /= np.where(span > 0, span, np.float32(1))
    return np.asarray(stretched.reshape(patches.shape))


def _structural_term(planes: FloatArray) -> FloatArray:
    """Dissimilarity (1 - SSIM) / 2 in 0..1 of squares of values in 0..1, planes 0 and 1 of (4, N, N, M). (M,).

    SSIM is the mean of (2 ab + C1) (2 cov + C2) / ((aa + bb + C1) (var_a + var_b + C2)), a and b being means, over all
    windows of 7 x 7 pixels inside the square, with unbiased variances: here a factor that C2 is divided by instead.
    Planes 2 and 3 are overwritten. The matches lie along the last axis: every step runs over all of them at once.
    """
    patches_a, patches_b, squares, product = planes
    np.multiply(patches_a, patches_a, out=squares)
    np.multiply(patches_b, patches_b, out=product)
    squares += product
    np.multiply(patches_a, patches_b, out=product)
    width = min(WINDOW_PX, len(patches_a))
    c1, c2 = STABILISERS[0], STABILISERS[1] * (1 - 1 / max(width, 2) ** 2)
    mean_a, mean_b, mean_squares, mean_product = _average_windows(planes, width)
    ab = mean_a * mean_b
    aa_bb = mean_a * mean_a + mean_b * mean_b
    quarter = (ab + c1 / 2) * (mean_product - ab + c2 / 2) / ((aa_bb + c1) * (mean_squares - aa_bb + c2))
    return np.asarray(np.clip(0.5 - 2 * quarter.mean(axis=(0, 1)), 0.0, 1.0))


def _average_windows(planes: FloatArray, width: int) -> FloatArray:
    """Average (4, N, N, M) planes over every window of the middle axes. (4, windows, windows, M).

    Two matrix products with a band of ones do it: one down the columns, one along the rows.
    """
    count, length = planes.shape[:2]
    offset = np.arange(length) - np.arange(length - width + 1)[:, None]
    band = np.asarray((offset >= 0) & (offset < width), dtype=float) / width
    down = np.matmul(band, planes.reshape(count, length, -1))
    return np.asarray(np.matmul(band, down.reshape(count, len(band), *planes.shape[2:])))


def _spatial_term(patches_a: FloatArray, patches_b: FloatArray) -> FloatArray:
    """Distance in 0..1 of how (N, N, M) squares of values in 0..1 spread their brightness. (M,).

    The vectors (N column means, N row means, mean of all) lie in a cube of side 1, so their Euclidean distance is
    divided by its diagonal, sqrt(2 N + 1).
    """
    difference = patches_a - patches_b
    columns, rows = difference.mean(axis=0), difference.mean(axis=1)
    squared = (columns * columns).sum(axis=0) + (rows * rows).sum(axis=0) + columns.mean(axis=0) ** 2
    return np.asarray(np.sqrt(squared / (2 * len(patches_a) + 1)))


def _check(patches_a: Patches, patches_b: Patches) -> None:
    shape = patches_a.shape
    if shape != patches_b.shape or len(shape) != 3 or shape[1] != shape[2] or shape[1] == 0:
        raise AsfmError(
            f"structural-and-spatial loss: expected two stacks of equal squares, found {shape} and {patches_b.shape}"
        )
    for name, patches in (("first", patches_a), ("second", patches_b)):
        if not np.isfinite(patches).all():
            bad = int(np.flatnonzero(~np.isfinite(patches).all(axis=(1, 2)))[0])
            raise AsfmError(f"structural-and-spatial loss: square {bad} of the {name} frame holds pixels not finite")
