"""Fan (Cartesian) image of a polar sonar image, and the map between the two.

Ahead (x) is up and port (y) is left. The sonar is at the middle of the bottom edge, or above it where beams point
backwards. Pixels are square, their centres at +0.5.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from asfm.errors import AsfmError
from asfm.geometry.sonar import SonarModel
from asfm.types import BoolArray, FloatArray

_Pixel = TypeVar("_Pixel", bound=np.generic)
_MAX_SIDE_PX = 16384
"""Half the limit of OpenCV's 16-bit remap; narrow sonars have tall fans."""


@dataclass(frozen=True, eq=False)
class FanGrid:
    """Pixel grid of the fan image of one sonar."""

    sonar: SonarModel
    width_px: int
    height_px: int
    pixel_m: float
    """Side of a pixel."""
    left_m: float
    """y of the left edge, sonar frame."""
    top_m: float
    """x of the top edge, sonar frame."""

    @classmethod
    def fit(cls, sonar: SonarModel, width_px: int, max_height_px: int | None = None) -> "FanGrid":
        """Fit a grid of a given width to the sonar's field of view, the sonar itself included.

        Args:
            sonar: pixel grid of the polar image.
            width_px: columns of the fan image.
            max_height_px: maximum number of rows; a taller fan is made narrower to fit.

        Raises:
            AsfmError: the width is not positive, or a side is longer than OpenCV's remap supports.
        """
        if width_px < 1:
            raise AsfmError(f"fan image: expected a width of at least 1 px, found {width_px}")
        x, y = _bounding_points(sonar)
        left_m = float(np.abs(y).max())
        pixel_m = 2 * left_m / width_px
        height_px = int(np.ceil((x.max() - x.min()) / pixel_m - 1e-9))
        if max_height_px is not None and height_px > max_height_px:
            return cls.fit(sonar, max(width_px * max_height_px // height_px, 1))
        if max(width_px, height_px) > _MAX_SIDE_PX:
            raise AsfmError(
                f"fan image: expected at most {_MAX_SIDE_PX} px a side, found {width_px} x {height_px} px; ask for a "
                f"width of {width_px * _MAX_SIDE_PX // max(width_px, height_px)} px or less"
            )
        return cls(sonar, width_px, height_px, pixel_m, left_m, float(x.min()) + height_px * pixel_m)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns) of the fan image."""
        return self.height_px, self.width_px

    def pixel_at(self, range_m: FloatArray, bearing_rad: FloatArray) -> FloatArray:
        """Map (...) ranges and bearings, broadcast against each other, to (..., 2) fractional columns and rows."""
        x, y = range_m * np.cos(bearing_rad), range_m * np.sin(bearing_rad)
        return np.stack([self.left_m - y, self.top_m - x], axis=-1) / self.pixel_m

    def range_bearing_at(self, xy_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Map (..., 2) fractional columns and rows, inside the fan or not, to (...) range_m and bearing_rad."""
        y, x = np.moveaxis(np.array([self.left_m, self.top_m]) - np.asarray(xy_px) * self.pixel_m, -1, 0)
        return np.hypot(x, y), np.arctan2(y, x)

    @cached_property
    def inside(self) -> BoolArray:
        """(rows, columns) true where the centre of the pixel is inside the fan."""
        range_m, bearing_rad = self._centres
        rows, columns = self.sonar.range_edges_m, self.sonar.bearing_edges_rad
        return np.asarray(
            (range_m >= rows[0]) & (range_m <= rows[-1]) & (bearing_rad >= columns[0]) & (bearing_rad <= columns[-1])
        )

    def draw(self, image: NDArray[_Pixel], fill: float = 0.0) -> NDArray[_Pixel]:
        """Resample a polar image to the fan image.

        Args:
            image: (ranges, beams) of float32 or uint8, interpolated linearly, or of bool, nearest pixel.
            fill: value outside the fan; NaN is allowed for float32.

        Returns:
            (rows, columns) of the type of the image.

        Raises:
            AsfmError: the image does not have the shape of the sonar.
        """
        import cv2

        if image.shape != self.sonar.shape:
            raise AsfmError(f"fan image: expected {self.sonar.shape} (ranges, beams), found {image.shape}")
        is_mask = image.dtype == np.bool_
        source: NDArray[Any] = image.view(np.uint8) if is_mask else image
        interpolation = cv2.INTER_NEAREST if is_mask else cv2.INTER_LINEAR
        fan = cv2.remap(np.ascontiguousarray(source), *self._maps, interpolation, borderMode=cv2.BORDER_REPLICATE)
        fan[~self.inside] = fill
        return np.asarray(fan.view(np.bool_) if is_mask else fan)

    @cached_property
    def _centres(self) -> tuple[FloatArray, FloatArray]:
        """Range and bearing of the pixel centres, (rows, columns) each."""
        rows, columns = np.indices(self.shape)
        return self.range_bearing_at(np.stack([columns, rows], axis=-1).astype(float) + 0.5)

    @cached_property
    def _maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Column and row of the polar image for each pixel, (rows, columns) each; OpenCV's pixel centres are at 0."""
        range_m, bearing_rad = self._centres
        columns, rows = self.sonar.column_at_bearing(bearing_rad), self.sonar.row_at_range(range_m)
        return (columns - 0.5).astype(np.float32), (rows - 0.5).astype(np.float32)


def _bounding_points(sonar: SonarModel) -> tuple[FloatArray, FloatArray]:
    """Return x and y of points that span the bounding box of the fan: the sonar, far corners, and axis crossings."""
    first, last = sonar.bearing_edges_rad[[0, -1]]
    axes = np.array([-np.pi, -np.pi / 2, 0.0, np.pi / 2, np.pi])
    bearing_rad = np.concatenate([[first, last], axes[(axes > first) & (axes < last)]])
    range_m = sonar.range_edges_m[-1]
    return np.append(range_m * np.cos(bearing_rad), 0.0), np.append(range_m * np.sin(bearing_rad), 0.0)
