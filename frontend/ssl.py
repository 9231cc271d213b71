"""The structural-and-spatial loss: do two keypoints' surroundings look alike?

Structural: one minus the structural similarity of the two squares (Wang et al. 2004). Spatial: the distance of the
vectors (mean of each column, mean of each row, mean of the square). Both lie in 0..1 and add up with their weights.
"""

import numpy as np
from numpy.typing import NDArray

from asfm.config import SslConfig
from asfm.errors import AsfmError
from asfm.types import FloatArray

WINDOW_PX = 7
"""Width of the windows whose similarities are averaged (less where the square is smaller)."""
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
    if len(patches_a) == 0:
        return np.zeros(0)
    unit_a, unit_b = stretch_patches(patches_a), stretch_patches(patches_b)
    loss = np.zeros(len(patches_a))
    if config.structural_weight > 0:
        loss += config.structural_weight * structural_term(unit_a, unit_b)
    if config.spatial_weight > 0:
        loss += config.spatial_weight * spatial_term(unit_a, unit_b)
    return loss


def stretch_patches(patches: Patches) -> FloatArray:
    """Stretch each of (M, N, N) squares to 0..1; a flat one becomes zero."""
    low, high = (reduce(patches, axis=(1, 2), keepdims=True).astype(float) for reduce in (np.min, np.max))
    span = high - low
    return np.asarray((patches - low) / np.where(span > 0, span, 1.0))


def structural_term(patches_a: Patches, patches_b: Patches) -> FloatArray:
    """Dissimilarity (1 - SSIM) / 2 in 0..1 of (M, N, N) squares of values in 0..1. (M,).

    SSIM is the mean over all windows of 7 x 7 pixels inside the square, with unbiased variances.
    """
    width = min(WINDOW_PX, patches_a.shape[-1])
    band = _window_band(patches_a.shape[-1], width)
    a, b = np.asarray(patches_a, dtype=float), np.asarray(patches_b, dtype=float)
    mean_a, mean_b, mean_squares, mean_product = (band.T @ (q @ band) for q in (a, b, a * a + b * b, a * b))
    c1, c2 = STABILISERS
    unbiased = width**2 / (width**2 - 1) if width > 1 else 1.0
    squared_means, product_of_means = mean_a**2 + mean_b**2, mean_a * mean_b
    variances = unbiased * (mean_squares - squared_means)
    covariance = unbiased * (mean_product - product_of_means)
    similarity = (2 * product_of_means + c1) * (2 * covariance + c2) / ((squared_means + c1) * (variances + c2))
    return np.asarray(np.clip(0.5 - 0.5 * similarity.mean(axis=(1, 2)), 0.0, 1.0))


def spatial_term(patches_a: Patches, patches_b: Patches) -> FloatArray:
    """Distance in 0..1 of how (M, N, N) squares of values in 0..1 spread their brightness. (M,).

    The vectors (N column means, N row means, mean of all) lie in a cube of side 1, so their Euclidean distance is
    divided by its diagonal, sqrt(2 N + 1).
    """
    difference = np.asarray(patches_a, dtype=float) - np.asarray(patches_b, dtype=float)
    columns, rows = difference.mean(axis=1), difference.mean(axis=2)
    squared = (columns**2).sum(axis=1) + (rows**2).sum(axis=1) + columns.mean(axis=1) ** 2
    return np.asarray(np.sqrt(squared / (2 * patches_a.shape[-1] + 1)))


def _window_band(length: int, width: int) -> FloatArray:
    """(length, length - width + 1) matrix that averages every run of ``width`` neighbours."""
    offset = np.arange(length)[:, None] - np.arange(length - width + 1)
    return np.asarray((offset >= 0) & (offset < width), dtype=float) / width


def _check(patches_a: Patches, patches_b: Patches) -> None:
    shape = patches_a.shape
    if shape != patches_b.shape or len(shape) != 3 or shape[1] != shape[2] or shape[1] == 0:
        raise AsfmError(
            f"structural-and-spatial loss: expected two stacks of equal squares, found {shape} and {patches_b.shape}"
        )
    for name, patches in (("first", patches_a), ("second", patches_b)):
        finite = np.isfinite(patches).all(axis=(1, 2))
        if not finite.all():
            bad = int(np.flatnonzero(~finite)[0])
            raise AsfmError(f"structural-and-spatial loss: square {bad} of the {name} frame holds pixels not finite")
