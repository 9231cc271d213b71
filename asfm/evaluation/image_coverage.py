"""Coverage of the image by keypoints and by matches: the share of cells of a fixed grid that hold one."""

from collections import abc
from dataclasses import dataclass

import numpy as np

from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray, IntArray, Keypoints, Matches

GRID = (16, 16)
"""Cells along range and along bearing; all have the same number of pixels, up to one."""


@dataclass(frozen=True)
class Coverage:
    """Share of the cells of :data:`GRID` that hold a keypoint, mean over the frames."""

    keypoints: float
    """Cells with any keypoint."""
    matches: float
    """Cells with a keypoint that is matched with any other frame."""


def measure_coverage(
    keypoints: abc.Sequence[Keypoints], matches: abc.Iterable[Matches], sonar: SonarModel
) -> Coverage | None:
    """Measure how much of the image keypoints and matches cover; None without frames.

    Args:
        keypoints: one set a frame.
        matches: any frame pairs.
        sonar: pixel grid.
    """
    if not keypoints:
        return None
    matched = [np.zeros(len(frame), dtype=bool) for frame in keypoints]
    for pair in matches:
        matched[pair.frame_a][pair.index[:, 0]] = True
        matched[pair.frame_b][pair.index[:, 1]] = True
    cells = [_find_cells(frame.row_column, sonar.shape) for frame in keypoints]
    total = GRID[0] * GRID[1] * len(keypoints)
    return Coverage(
        keypoints=sum(len(np.unique(cell)) for cell in cells) / total,
        matches=sum(len(np.unique(cell[which])) for cell, which in zip(cells, matched, strict=True)) / total,
    )


def _find_cells(row_column: FloatArray, shape: tuple[int, int]) -> IntArray:
    """Return the number of the cell of each of (K, 2) fractional pixels of an image of a shape."""
    cell = np.floor(row_column * GRID / np.array(shape)).astype(np.int64)
    row, column = np.clip(cell, 0, np.array(GRID) - 1).T
    return np.asarray(row * GRID[1] + column)
