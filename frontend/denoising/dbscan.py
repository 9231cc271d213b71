"""DBSCAN on the pixel grid: removal of isolated detections and clustering of the others.

With pixels as points (Ester et al. 1996) the neighbourhood is a disc, so the density is a count over a disc, and the
pixels reachable from core pixels are a dilation with that disc.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from asfm.config import DbscanConfig
from asfm.errors import AsfmError
from asfm.types import BoolArray, IntArray

Disc = NDArray[np.uint8]


def dbscan_mask(detections: BoolArray, config: DbscanConfig) -> BoolArray:
    """Remove the detections that DBSCAN labels as noise.

    A detection is a core pixel if at least ``min_pixels`` detections, itself included, lie within ``radius_px``. It is
    kept if a core pixel lies within ``radius_px``.

    Args:
        detections: (ranges, beams) true where detected.
        config: radius and minimum density.

    Returns:
        (ranges, beams) true for the detections that belong to a cluster.

    Raises:
        AsfmError: the mask is not two-dimensional.
    """
    disc = _disc(config.radius_px, _check_rank(detections))
    cores = _find_cores(detections, disc, config.min_pixels)
    if not cores.any():
        return cores
    return np.asarray(cv2.dilate(cores.view(np.uint8), disc).view(np.bool_) & detections)


def dbscan_labels(detections: BoolArray, config: DbscanConfig) -> IntArray:
    """Label the DBSCAN clusters of the detections, with the same labels as scikit-learn's DBSCAN.

    Core pixels within ``radius_px`` of each other share a cluster. A border pixel takes the first cluster with a core
    pixel within ``radius_px``; a detection without one is noise.

    Args:
        detections: (ranges, beams) true where detected.
        config: radius and minimum density.

    Returns:
        (ranges, beams) labels 0, 1, 2 ... by the first core pixel in row-major order, -1 for noise and elsewhere.

    Raises:
        AsfmError: the mask is not two-dimensional.
    """
    disc = _disc(config.radius_px, _check_rank(detections))
    cores = _find_cores(detections, disc, config.min_pixels)
    if not cores.any():
        return np.full(detections.shape, -1, dtype=np.int64)
    core_index = np.flatnonzero(cores)
    label = _renumber_by_first(_connect_cores(cores, disc, config.radius_px, core_index))
    # A dilation returns the maximum of a neighbourhood, so the first cluster gets the largest weight.
    count = int(label.max()) + 1
    weight = np.zeros(detections.shape, dtype=np.uint16 if count < 2**16 else np.float32)
    weight.ravel()[core_index] = count - label
    reached = cv2.dilate(weight, disc)
    clustered = np.flatnonzero((reached > 0) & detections)
    labels = np.full(detections.shape, -1, dtype=np.int64)
    labels.ravel()[clustered] = count - reached.ravel().take(clustered).astype(np.int64)
    return labels


def _disc(radius_px: float, shape: tuple[int, ...]) -> Disc:
    """Return a (2h + 1, 2w + 1) disc of ones within the radius of the centre, clipped to the size of the image."""
    rows, columns = (min(int(radius_px), max(length - 1, 0)) for length in shape)
    row, column = np.mgrid[-rows : rows + 1, -columns : columns + 1]
    return np.asarray(row**2 + column**2 <= radius_px**2, dtype=np.uint8)


def _find_cores(detections: BoolArray, disc: Disc, min_pixels: int) -> BoolArray:
    """Mark the core pixels; the count over the disc is a sum of box filters, one for each row of the disc."""
    if not detections.any():
        return np.zeros(detections.shape, dtype=bool)
    depth, dtype = (cv2.CV_16U, np.uint16) if disc.sum() < 2**16 else (cv2.CV_32S, np.int32)
    height, half = len(detections), len(disc) // 2
    padded = cv2.copyMakeBorder(detections.view(np.uint8), half, half, 0, 0, cv2.BORDER_CONSTANT)
    run_widths = disc.sum(axis=1, dtype=int)
    density = np.zeros(detections.shape, dtype=dtype)
    for width in np.unique(run_widths).tolist():
        runs = cv2.boxFilter(padded, depth, (width, 1), normalize=False, borderType=cv2.BORDER_CONSTANT)
        for row in np.flatnonzero(run_widths == width).tolist():
            density += runs[row : row + height]
    return np.asarray((density >= min_pixels) & detections)


def _connect_cores(cores: BoolArray, disc: Disc, radius_px: float, core_index: IntArray) -> IntArray:
    """Label the connected sets of core pixels: one label for each core pixel, (N,) in row-major order.

    Adjacent pixels are joined by connected components; larger radii then join components across gaps.
    """
    if radius_px < 1:
        return np.arange(len(core_index))
    connectivity = 8 if radius_px**2 >= 2 else 4
    count, components = cv2.connectedComponents(cores.view(np.uint8), connectivity=connectivity, ltype=cv2.CV_32S)
    core_component: IntArray = components.ravel().take(core_index).astype(np.int64)
    if radius_px < 2 or count == 2:  # component 0 is the background
        return core_component
    return np.asarray(_join_components(*_neighbouring_components(cores, components, disc), count).take(core_component))


def _neighbouring_components(
    cores: BoolArray, components: NDArray[np.int32], disc: Disc
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """List the pairs of components with pixels within the radius of each other, (P,) and (P,), with repetitions.

    The two nearest pixels of two components lie on their boundaries, so only boundary pixels are searched from, and by
    symmetry only half of the disc.
    """
    interior = cv2.erode(cores.view(np.uint8), np.ones((3, 3), dtype=np.uint8)).view(np.bool_)
    boundary = np.flatnonzero(cores > interior)
    half_rows, half_columns = (length // 2 for length in disc.shape)
    padded = cv2.copyMakeBorder(components, 0, half_rows, half_columns, half_columns, cv2.BORDER_CONSTANT)
    stride = padded.shape[1]
    padded_index = boundary + boundary // cores.shape[1] * (2 * half_columns) + half_columns
    offsets = np.argwhere(disc[half_rows:]) - (0, half_columns)
    offsets = offsets[(offsets[:, 0] > 0) | (offsets[:, 1] > 1)]
    own = components.ravel().take(boundary)
    pairs = [(own[:0], own[:0])]
    for row, column in offsets:
        other = padded.ravel().take(padded_index + (row * stride + column))
        differs = np.flatnonzero((other != own) & (other > 0))
        pairs.append((own.take(differs), other.take(differs)))
    return np.concatenate([a for a, _ in pairs]), np.concatenate([b for _, b in pairs])


def _join_components(own: NDArray[np.integer], other: NDArray[np.integer], count: int) -> IntArray:
    """Label the (count,) components by the smallest component that chains of (N,) pairs join them to.

    Union-find on arrays: hook each component onto a smaller one it is paired with, compress the paths, and repeat with
    the pairs that still have different roots.
    """
    root = np.arange(count)
    while len(own):
        root[np.maximum(own, other)] = np.minimum(own, other)
        while True:
            compressed = root.take(root)
            if np.array_equal(compressed, root):
                break
            root = compressed
        own, other = root.take(own), root.take(other)
        differs = own != other
        own, other = own[differs], other[differs]
    return root


def _renumber_by_first(labels: IntArray) -> IntArray:
    """Renumber (N,) non-negative labels as 0, 1, 2 ... in the order of their first appearance: (N,)."""
    first = np.full(int(labels.max()) + 1, len(labels))
    first[labels[::-1]] = np.arange(len(labels))[::-1]  # of repeated indices NumPy keeps the last assignment
    number = np.empty(len(first), dtype=np.int64)
    number[np.argsort(first)] = np.arange(len(first))
    return np.asarray(number[labels])


def _check_rank(detections: BoolArray) -> tuple[int, ...]:
    if detections.ndim != 2:
        raise AsfmError(f"DBSCAN: expected a mask of shape (ranges, beams), found the shape {detections.shape}")
    return detections.shape
