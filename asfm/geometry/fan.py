"""The fan: a polar sonar image drawn to scale, as a person looking along the sonar sees it.

In the picture ahead (x) is up and port (y) is left; the sonar sits at the middle of the bottom edge, or above it where
the beams reach behind the sonar. Pixels are square, their centres at +0.5.
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
_LARGEST_SIDE_PX = 16384
"""Half of what OpenCV's 16-bit remap can address; a narrow beam makes a tall fan."""


@dataclass(frozen=True, eq=False)
class FanGrid:
    """The pixels of one sonar's fan."""

    sonar: SonarModel
    width_px: int
    height_px: int
    pixel_m: float
    """Side of a pixel."""
    left_m: float
    """y of the picture's left edge."""
    top_m: float
    """x of the picture's top edge."""

    @classmethod
    def fit(cls, sonar: SonarModel, width_px: int, max_height_px: int | None = None) -> "FanGrid":
        """Fit a fan of a given width around everything that a sonar sees, the sonar itself included.

        Where that would be higher than a limit, the fan is made as narrow as that takes.

        Raises:
            AsfmError: the width is not positive, or the fan would be taller than OpenCV can draw.
        """
        if width_px < 1:
            raise AsfmError(f"fan image: expected a width of at least 1 px, found {width_px}")
        x, y = _outline(sonar)
        left_m = float(np.abs(y).max())
        pixel_m = 2 * left_m / width_px
        height_px = int(np.ceil((x.max() - x.min()) / pixel_m - 1e-9))
        if max_height_px is not None and height_px > max_height_px:
            return cls.fit(sonar, max(width_px * max_height_px // height_px, 1))
        if max(width_px, height_px) > _LARGEST_SIDE_PX:
            raise AsfmError(
                f"fan image: {width_px} x {height_px} px is more than {_LARGEST_SIDE_PX} px a side; ask for a width of "
                f"{width_px * _LARGEST_SIDE_PX // max(width_px, height_px)} px or less"
            )
        return cls(sonar, width_px, height_px, pixel_m, left_m, float(x.min()) + height_px * pixel_m)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns) of the picture."""
        return self.height_px, self.width_px

    def pixel_at(self, range_m: FloatArray, bearing_rad: FloatArray) -> FloatArray:
        """Place (range, bearing), broadcast against each other, in the picture: (..., 2) fractional column and row."""
        x, y = range_m * np.cos(bearing_rad), range_m * np.sin(bearing_rad)
        return np.stack([self.left_m - y, self.top_m - x], axis=-1) / self.pixel_m

    def range_bearing_at(self, xy_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Read (range_m, bearing_rad) off (..., 2) fractional columns and rows, inside the fan or not."""
        y, x = np.moveaxis(np.array([self.left_m, self.top_m]) - np.asarray(xy_px) * self.pixel_m, -1, 0)
        return np.hypot(x, y), np.arctan2(y, x)

    @cached_property
    def inside(self) -> BoolArray:
        """(rows, columns), true where the centre of the pixel lies inside the fan."""
        range_m, bearing_rad = self._centres
        rows, columns = self.sonar.range_edges_m, self.sonar.bearing_edges_rad
        return np.asarray(
            (range_m >= rows[0]) & (range_m <= rows[-1]) & (bearing_rad >= columns[0]) & (bearing_rad <= columns[-1])
        )

    def draw(self, image: NDArray[_Pixel], fill: float = 0.0) -> NDArray[_Pixel]:
        """Draw a polar image as a fan.

        Args:
            image: (ranges, beams) of float32 or uint8, sampled linearly, or of bool, sampled at the nearest pixel.
            fill: the value outside the fan; NaN is allowed for float32.

        Returns:
            (rows, columns) of the image's type.

        Raises:
            AsfmError: the image is not of the sonar's shape.
        """
        import cv2

        if image.shape != self.sonar.shape:
            raise AsfmError(f"fan image: expected {self.sonar.shape} (ranges, beams), found {image.shape}")
        logical = image.dtype == np.bool_
        source: NDArray[Any] = image.view(np.uint8) if logical else image
        how = cv2.INTER_NEAREST if logical else cv2.INTER_LINEAR
        fan = cv2.remap(np.ascontiguousarray(source), *self._maps, how, borderMode=cv2.BORDER_REPLICATE)
        fan[~self.inside] = fill
        return np.asarray(fan.view(np.bool_) if logical else fan)

    @cached_property
    def _centres(self) -> tuple[FloatArray, FloatArray]:
        rows, columns = np.indices(self.shape)
        return self.range_bearing_at(np.stack([columns, rows], axis=-1).astype(float) + 0.5)

    @cached_property
    def _maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Column and row of the polar image under each pixel; OpenCV counts from the pixels' centres."""
        range_m, bearing_rad = self._centres
        columns, rows = self.sonar.column_at_bearing(bearing_rad), self.sonar.row_at_range(range_m)
        return (columns - 0.5).astype(np.float32), (rows - 0.5).astype(np.float32)


def _outline(sonar: SonarModel) -> tuple[FloatArray, FloatArray]:
    """X and y of points that hold the fan's bounding box: the sonar, the far corners, and the axes between them."""
    first, last = sonar.bearing_edges_rad[[0, -1]]
    axes = np.array([-np.pi, -np.pi / 2, 0.0, np.pi / 2, np.pi])
    bearing_rad = np.concatenate([[first, last], axes[(axes > first) & (axes < last)]])
    range_m = sonar.range_edges_m[-1]
    return np.append(range_m * np.cos(bearing_rad), 0.0), np.append(range_m * np.sin(bearing_rad), 0.0)
