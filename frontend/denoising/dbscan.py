"""DBSCAN on the pixel grid: lone detections are noise.

On a grid the neighbours of a pixel are a disc (Ester et al. 1996 with the pixels as points), so density is a count
over a disc, and what a core reaches is a dilation with that disc.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from asfm.config import DbscanConfig
from asfm.errors import AsfmError
from asfm.types import BoolArray, IntArray

Disc = NDArray[np.uint8]


def dbscan_mask(detections: BoolArray, config: DbscanConfig) -> BoolArray:
    """Remove the detections that DBSCAN calls noise.

    A detection is a core where ``min_pixels`` detections, itself included, lie within ``radius_px``; it stays where a
    core lies within ``radius_px``.

    Args:
        detections: (ranges, beams) true where detected.
        config: radius and density.

    Returns:
        (ranges, beams) the detections that belong to a cluster.

    Raises:
        AsfmError: the mask is not two-dimensional.
    """
    disc = _disc(config.radius_px, _check(detections))
    cores = _find_cores(detections, disc, config.min_pixels)
    if not cores.any():
        return cores
    return np.asarray(cv2.dilate(cores.view(np.uint8), disc).view(np.bool_) & detections)


def dbscan_labels(detections: BoolArray, config: DbscanConfig) -> IntArray:
    """Number the clusters of the detections: 0, 1, 2 ... by their first core in reading order, -1 elsewhere.

    Cores within ``radius_px`` of each other share a cluster. Any other detection takes the first cluster with a core
    within ``radius_px``; where there is none it is noise. These are the labels that scikit-learn's DBSCAN gives.

    Args:
        detections: (ranges, beams) true where detected.
        config: radius and density.

    Returns:
        (ranges, beams) labels.

    Raises:
        AsfmError: the mask is not two-dimensional.
    """
    disc = _disc(config.radius_px, _check(detections))
    cores = _find_cores(detections, disc, config.min_pixels)
    if not cores.any():
        return np.full(detections.shape, -1, dtype=np.int64)
    where = np.flatnonzero(cores)
    label = _number_by_first(_connect(cores, disc, config.radius_px, where))
    # A dilation takes the greatest of its neighbourhood, so let the first cluster weigh most.
    count = int(label.max()) + 1
    weight = np.zeros(detections.shape, dtype=np.uint16 if count < 2**16 else np.float32)
    weight.ravel()[where] = count - label
    reached = cv2.dilate(weight, disc)
    found = np.flatnonzero((reached > 0) & detections)
    labels = np.full(detections.shape, -1, dtype=np.int64)
    labels.ravel()[found] = count - reached.ravel().take(found).astype(np.int64)
    return labels


def _disc(radius_px: float, shape: tuple[int, ...]) -> Disc:
    """(2h + 1, 2w + 1) ones at the pixels within the radius of the middle; no larger than the image calls for."""
    rows, columns = (min(int(radius_px), max(length - 1, 0)) for length in shape)
    row, column = np.mgrid[-rows : rows + 1, -columns : columns + 1]
    return np.asarray(row**2 + column**2 <= radius_px**2, dtype=np.uint8)


def _find_cores(detections: BoolArray, disc: Disc, min_pixels: int) -> BoolArray:
    """Mark the detections with enough others in the disc around them, counted a run of pixels at a time."""
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


def _connect(cores: BoolArray, disc: Disc, radius_px: float, where: IntArray) -> IntArray:
    """Name the sets of cores in reach of each other, over any number of cores: one name a core, in reading order."""
    if radius_px < 1:
        return np.arange(len(where))
    adjacency = 8 if radius_px**2 >= 2 else 4
    count, names = cv2.connectedComponents(cores.view(np.uint8), connectivity=adjacency, ltype=cv2.CV_32S)
    own_names: IntArray = names.ravel().take(where).astype(np.int64)
    if radius_px < 2 or count == 2:  # the first name is that of what is no core
        return own_names
    return np.asarray(_join(*_pair_sets(cores, names, disc), count).take(own_names))


def _pair_sets(cores: BoolArray, names: NDArray[np.int32], disc: Disc) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """List pairs of adjacent sets' names, repeatedly, for every two pixels of both that lie within the radius.

    Where two sets are nearest to each other neither pixel is surrounded by cores, else a neighbour would be nearer:
    only the rims of the sets need to look around, and half the disc is enough.
    """
    surrounded = cv2.erode(cores.view(np.uint8), np.ones((3, 3), dtype=np.uint8)).view(np.bool_)
    rim = np.flatnonzero(cores > surrounded)
    half_rows, half_columns = (length // 2 for length in disc.shape)
    padded = cv2.copyMakeBorder(names, 0, half_rows, half_columns, half_columns, cv2.BORDER_CONSTANT)
    stride = padded.shape[1]
    here = rim + rim // cores.shape[1] * (2 * half_columns) + half_columns
    offsets = np.argwhere(disc[half_rows:]) - (0, half_columns)
    offsets = offsets[(offsets[:, 0] > 0) | (offsets[:, 1] > 1)]
    own = names.ravel().take(rim)
    pairs = [(own[:0], own[:0])]
    for row, column in offsets:
        other = padded.ravel().take(here + (row * stride + column))
        apart = np.flatnonzero((other != own) & (other > 0))
        pairs.append((own.take(apart), other.take(apart)))
    return np.concatenate([a for a, _ in pairs]), np.concatenate([b for _, b in pairs])


def _join(own: NDArray[np.integer], other: NDArray[np.integer], count: int) -> IntArray:
    """Give all of ``count`` sets that pairs of (N,) names join the least name among them. (count,).

    Every set hooks onto one before it that it meets, and follows the hooks to their end; pairs that still differ go on.
    """
    name = np.arange(count)
    while len(own):
        name[np.maximum(own, other)] = np.minimum(own, other)
        while True:
            further = name.take(name)
            if np.array_equal(further, name):
                break
            name = further
        own, other = name.take(own), name.take(other)
        apart = own != other
        own, other = own[apart], other[apart]
    return name


def _number_by_first(names: IntArray) -> IntArray:
    """Renumber (N,) names, 0 or more, as 0, 1, 2 ... in the order of their first appearance. (N,)."""
    first = np.full(int(names.max()) + 1, len(names))
    first[names[::-1]] = np.arange(len(names))[::-1]  # of equal indices the last one counts
    number = np.empty(len(first), dtype=np.int64)
    number[np.argsort(first)] = np.arange(len(first))
    return np.asarray(number[names])


def _check(detections: BoolArray) -> tuple[int, ...]:
    if detections.ndim != 2:
        raise AsfmError(f"clusters: expected a mask (ranges, beams), found the shape {detections.shape}")
    return detections.shape
