"""DBSCAN on the pixel grid: lone detections are noise.

On a grid the neighbours of a pixel are a disc (Ester et al. 1996 with the pixels as points), so density is a count
over a disc, and what a core reaches is a dilation with that disc.
"""

import cv2
import numpy as np
from asfm.config import ClustersConfig
from asfm.errors import AsfmError
from asfm.types import BoolArray
from numpy.typing import NDArray


def keep_clusters(detections: BoolArray, config: ClustersConfig) -> BoolArray:
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
    _check(detections)
    disc = _disc(config.radius_px, detections.shape)
    cores = _find_cores(detections, disc, config.min_pixels)
    return np.asarray(cv2.dilate(cores.view(np.uint8), disc).view(np.bool_) & detections)


def _disc(radius_px: float, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """(2h + 1, 2w + 1) ones at the pixels within the radius of the middle; no larger than the image calls for."""
    rows, columns = (min(int(radius_px), max(length - 1, 0)) for length in shape)
    row, column = np.mgrid[-rows : rows + 1, -columns : columns + 1]
    return np.asarray(np.hypot(row, column) <= radius_px, dtype=np.uint8)


def _find_cores(detections: BoolArray, disc: NDArray[np.uint8], min_pixels: int) -> BoolArray:
    return np.asarray(detections & (_count_disc(detections, disc) >= min_pixels))


def _count_disc(mask: BoolArray, disc: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Count the true pixels in the disc around each pixel: exact sums of one run of pixels a row of the disc."""
    height, half = mask.shape[0], len(disc) // 2
    padded = cv2.copyMakeBorder(mask.view(np.uint8), half, half, 0, 0, cv2.BORDER_CONSTANT)
    run_widths = disc.sum(axis=1, dtype=int)
    density = np.zeros(mask.shape, dtype=np.int32)
    for width in np.unique(run_widths).tolist():
        runs = cv2.boxFilter(padded, cv2.CV_32S, (width, 1), normalize=False, borderType=cv2.BORDER_CONSTANT)
        for row in np.flatnonzero(run_widths == width).tolist():
            density += runs[row : row + height]
    return density


def _check(detections: BoolArray) -> None:
    if detections.ndim != 2:
        raise AsfmError(f"clusters: expected a mask (ranges, beams), found the shape {detections.shape}")
