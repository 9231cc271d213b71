"""Image warps for feature detection: polar image stretched to near-square pixels, or Cartesian (fan) image."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from asfm.config import KeypointsConfig
from asfm.geometry.fan import FanGrid
from asfm.geometry.sonar import SonarModel
from asfm.types import BoolArray, FloatArray, ImageArray

MAX_FAN_SIDE_PX = 2048
"""Longest side of the Cartesian image."""


class ImageWarp(Protocol):
    """Map from the polar image to the image in which features are detected, and its inverse."""

    def warp(self, image: ImageArray) -> ImageArray:
        """Warp a (ranges, beams) image: (height, width)."""

    def warp_mask(self, mask: BoolArray) -> NDArray[np.uint8]:
        """Warp a (ranges, beams) mask: (height, width), non-zero where features may be detected."""

    def to_polar(self, xy_px: FloatArray) -> FloatArray:
        """Map (K, 2) fractional columns and rows of the warped image to (K, 2) rows and columns of the polar image."""

    def from_polar(self, row_column: FloatArray) -> FloatArray:
        """Map (K, 2) fractional rows and columns of the polar image to (K, 2) columns and rows of the warped image."""


@dataclass(frozen=True)
class StretchedPolarWarp:
    """Polar image with a stretched bearing axis."""

    shape: tuple[int, int]
    """(ranges, beams) of the polar image."""
    width_px: int
    """Columns of the warped image."""

    def warp(self, image: ImageArray) -> ImageArray:
        """See :class:`ImageWarp`."""
        return np.asarray(cv2.resize(image, (self.width_px, self.shape[0]), interpolation=cv2.INTER_LINEAR))

    def warp_mask(self, mask: BoolArray) -> NDArray[np.uint8]:
        """See :class:`ImageWarp`."""
        size = (self.width_px, self.shape[0])
        return np.asarray(cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST))

    def to_polar(self, xy_px: FloatArray) -> FloatArray:
        """See :class:`ImageWarp`."""
        return np.stack([xy_px[:, 1], xy_px[:, 0] * (self.shape[1] / self.width_px)], axis=1)

    def from_polar(self, row_column: FloatArray) -> FloatArray:
        """See :class:`ImageWarp`."""
        return np.stack([row_column[:, 1] * (self.width_px / self.shape[1]), row_column[:, 0]], axis=1)


@dataclass(frozen=True, eq=False)
class CartesianWarp:
    """Cartesian (fan) image of square pixels.

    The image is replicated beyond the border of the fan, so that the border itself causes no features.
    """

    grid: FanGrid

    def warp(self, image: ImageArray) -> ImageArray:
        """See :class:`ImageWarp`."""
        return self._remap(image, cv2.INTER_LINEAR)

    def warp_mask(self, mask: BoolArray) -> NDArray[np.uint8]:
        """See :class:`ImageWarp`."""
        return np.where(self.grid.inside, self._remap(mask.astype(np.uint8), cv2.INTER_NEAREST), np.uint8(0))

    def to_polar(self, xy_px: FloatArray) -> FloatArray:
        """See :class:`ImageWarp`."""
        range_m, bearing_rad = self.grid.range_bearing_at(xy_px)
        sonar = self.grid.sonar
        return np.stack([sonar.row_at_range(range_m), sonar.column_at_bearing(bearing_rad)], axis=1)

    def from_polar(self, row_column: FloatArray) -> FloatArray:
        """See :class:`ImageWarp`."""
        sonar = self.grid.sonar
        return self.grid.pixel_at(sonar.range_at_row(row_column[:, 0]), sonar.bearing_at_column(row_column[:, 1]))

    def _remap(self, image: NDArray[Any], interpolation: int) -> NDArray[Any]:
        source = np.ascontiguousarray(image)
        return np.asarray(cv2.remap(source, *self._maps, interpolation, borderMode=cv2.BORDER_REPLICATE))

    @cached_property
    def _maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Column and row of the polar image for each pixel, (height, width) each; OpenCV's pixel centres are at 0."""
        rows, columns = np.indices(self.grid.shape)
        centres = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float) + 0.5
        row_column = self.to_polar(centres) - 0.5
        row, column = row_column.astype(np.float32).T.reshape(2, *self.grid.shape)
        return np.ascontiguousarray(column), np.ascontiguousarray(row)


@lru_cache(maxsize=4)
def make_image_warp(sonar: SonarModel, settings: KeypointsConfig) -> ImageWarp:
    """Make the warp that the settings select, cached for each sonar.

    Pixels of the Cartesian image are as long as a range bin, unless its sides would exceed ``MAX_FAN_SIDE_PX``.

    Args:
        sonar: pixel grid of the polar image.
        settings: space and max_stretch are used.
    """
    if settings.space == "polar":
        return StretchedPolarWarp(sonar.shape, round(sonar.shape[1] * column_stretch(sonar, settings)))
    half_width_m = FanGrid.fit(sonar, 1).left_m
    width_px = int(np.clip(round(2 * half_width_m / sonar.range_step_m), 1, MAX_FAN_SIDE_PX))
    return CartesianWarp(FanGrid.fit(sonar, width_px, MAX_FAN_SIDE_PX))


def column_stretch(sonar: SonarModel, settings: KeypointsConfig) -> float:
    """Return the stretch of the bearing axis that makes pixels square at the middle range, within 1..max_stretch."""
    middle_m = 0.5 * (sonar.range_edges_m[0] + sonar.range_edges_m[-1])
    return float(np.clip(middle_m * sonar.bearing_step_rad / sonar.range_step_m, 1.0, settings.max_stretch))
