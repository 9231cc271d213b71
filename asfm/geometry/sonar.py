"""Imaging sonar model: projection (equations (1) and (2) of the paper), pixel grid and elevation arcs.

A point p = (x, y, z) of the sonar frame (x forward, y to port, z up) is observed at range r = |p|, bearing
theta = atan2(y, x) and elevation phi = atan2(z, hypot(x, y)). The image measures r and theta but not phi.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from asfm.types import BoolArray, FloatArray


def project(xyz_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Project (..., 3) points of the sonar frame to (...) range_m, bearing_rad and elevation_rad: equation (1)."""
    x, y, z = np.moveaxis(np.asarray(xyz_m, dtype=float), -1, 0)
    horizontal = np.hypot(x, y)
    return np.hypot(horizontal, z), np.arctan2(y, x), np.arctan2(z, horizontal)


def back_project(range_m: FloatArray, bearing_rad: FloatArray, elevation_rad: FloatArray | float) -> FloatArray:
    """Back-project ranges, bearings and elevations, broadcast together, to (..., 3) points: equation (2)."""
    range_m, bearing_rad, elevation_rad = np.broadcast_arrays(range_m, bearing_rad, elevation_rad)
    horizontal = range_m * np.cos(elevation_rad)
    return np.stack(
        [horizontal * np.cos(bearing_rad), horizontal * np.sin(bearing_rad), range_m * np.sin(elevation_rad)], axis=-1
    )


def edges_from_centres(centres: FloatArray) -> FloatArray:
    """Compute (N + 1,) bin edges midway between (N,) centres; the outer bins are symmetric about their centres.

    Raises:
        ValueError: there is only one centre, so that the width of the bin is unknown.
    """
    if len(centres) == 1:
        raise ValueError("bin edges: expected at least two bin centres, found one")
    middle = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])


@dataclass(frozen=True, eq=False)
class SonarModel:
    """Pixel grid and field of view of one sonar; ranges and beams may be spaced unevenly.

    Rows and columns are fractional, with pixel centres at +0.5: row i spans i..i+1.
    """

    name: str
    range_m: FloatArray
    """(ranges,) centre of each row, strictly increasing."""
    bearing_rad: FloatArray
    """(beams,) centre of each column, strictly increasing: starboard (negative) to port (positive)."""
    elevation_aperture_rad: float
    """Full elevation aperture: echoes come from -aperture/2 to +aperture/2."""

    @classmethod
    def evenly_spaced(
        cls,
        name: str,
        range_m: tuple[float, float],
        bearing_rad: tuple[float, float],
        shape: tuple[int, int],
        elevation_aperture_rad: float,
    ) -> "SonarModel":
        """Make a model with evenly spaced rows and columns.

        Args:
            name: name of the sonar.
            range_m: near edge of the first row and far edge of the last one.
            bearing_rad: outer edges of the first and the last column.
            shape: (ranges, beams) of the image.
            elevation_aperture_rad: full elevation aperture.
        """
        row_edges = np.linspace(*range_m, shape[0] + 1)
        column_edges = np.linspace(*bearing_rad, shape[1] + 1)
        centres = [0.5 * (edges[1:] + edges[:-1]) for edges in (row_edges, column_edges)]
        return cls(name, centres[0], centres[1], elevation_aperture_rad)

    @property
    def shape(self) -> tuple[int, int]:
        """(ranges, beams)."""
        return len(self.range_m), len(self.bearing_rad)

    @cached_property
    def range_edges_m(self) -> FloatArray:
        """(ranges + 1,) edges of the rows, increasing; the nearest is clipped to zero."""
        edges = edges_from_centres(self.range_m)
        edges[0] = max(edges[0], 0.0)
        return edges

    @cached_property
    def bearing_edges_rad(self) -> FloatArray:
        """(beams + 1,) edges of the columns, increasing."""
        return edges_from_centres(self.bearing_rad)

    @property
    def range_step_m(self) -> float:
        """Median range step between rows."""
        return float(np.median(np.diff(self.range_m)))

    @property
    def bearing_step_rad(self) -> float:
        """Median bearing step between columns."""
        return float(np.median(np.diff(self.bearing_rad)))

    def range_at_row(self, row: FloatArray) -> FloatArray:
        """Return range_m of fractional rows of any shape, clipped to the image."""
        return _values_at_pixels(row, self.range_m, self.range_edges_m)

    def bearing_at_column(self, column: FloatArray) -> FloatArray:
        """Return bearing_rad of fractional columns of any shape, clipped to the image."""
        return _values_at_pixels(column, self.bearing_rad, self.bearing_edges_rad)

    def row_at_range(self, range_m: FloatArray) -> FloatArray:
        """Return fractional rows of ranges of any shape, clipped to the image; see :meth:`sees`."""
        return _pixels_of_values(range_m, self.range_m, self.range_edges_m)

    def column_at_bearing(self, bearing_rad: FloatArray) -> FloatArray:
        """Return fractional columns of bearings of any shape, clipped to the image."""
        return _pixels_of_values(bearing_rad, self.bearing_rad, self.bearing_edges_rad)

    def sees(self, xyz_m: FloatArray) -> BoolArray:
        """Return which of (..., 3) points of the sonar frame are in the field of view: (...)."""
        range_m, bearing_rad, elevation_rad = project(xyz_m)
        return np.asarray(
            (range_m >= self.range_edges_m[0])
            & (range_m <= self.range_edges_m[-1])
            & (bearing_rad >= self.bearing_edges_rad[0])
            & (bearing_rad <= self.bearing_edges_rad[-1])
            & (np.abs(elevation_rad) <= self.elevation_aperture_rad / 2)
        )

    def elevations(self, count: int) -> FloatArray:
        """Return (count,) elevation_rad evenly spaced over the aperture, its ends included."""
        half = self.elevation_aperture_rad / 2
        return np.linspace(-half, half, count)

    def elevation_arc(self, range_m: FloatArray, bearing_rad: FloatArray, count: int = 15) -> FloatArray:
        """Compute the elevation arcs of pixels: equation (2) at fixed range and bearing over the aperture.

        Args:
            range_m: (...) ranges.
            bearing_rad: (...) bearings.
            count: number of points of each arc.

        Returns:
            (..., count, 3) points of the sonar frame, in metres.
        """
        return back_project(np.asarray(range_m)[..., None], np.asarray(bearing_rad)[..., None], self.elevations(count))


def project_jacobian(xyz_m: FloatArray) -> FloatArray:
    """Compute the Jacobian of equation (1) at (..., 3) points of the sonar frame.

    Returns:
        (..., 3, 3): rows range_m, bearing_rad and elevation_rad; columns x, y and z.
    """
    x, y, z = np.moveaxis(xyz_m, -1, 0)
    horizontal2 = np.maximum(x**2 + y**2, 1e-12)
    horizontal = np.sqrt(horizontal2)
    range2 = horizontal2 + z**2
    range_m = np.sqrt(range2)
    zero = np.zeros_like(x)
    rows = [
        np.stack([x / range_m, y / range_m, z / range_m], axis=-1),
        np.stack([-y / horizontal2, x / horizontal2, zero], axis=-1),
        np.stack([-x * z / (horizontal * range2), -y * z / (horizontal * range2), horizontal / range2], axis=-1),
    ]
    return np.stack(rows, axis=-2)


def _knots(centres: FloatArray, edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return pixel coordinates and values, (N + 2,) each, of the first edge, the N centres and the last edge."""
    count = len(centres)
    pixels = np.concatenate([[0.0], np.arange(count) + 0.5, [float(count)]])
    return pixels, np.concatenate([edges[:1], centres, edges[-1:]])


def _values_at_pixels(pixel: FloatArray, centres: FloatArray, edges: FloatArray) -> FloatArray:
    pixels, values = _knots(centres, edges)
    return np.asarray(np.interp(pixel, pixels, values))


def _pixels_of_values(value: FloatArray, centres: FloatArray, edges: FloatArray) -> FloatArray:
    pixels, values = _knots(centres, edges)
    return np.asarray(np.interp(value, values, pixels))
