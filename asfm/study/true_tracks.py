"""True tracks: points of a simulated scene followed through the frames by its true poses and elevations."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asfm.evaluation.true_positions import look_up_elevation
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.types import BoolArray, FloatArray, FrameTruth, IntArray

MAX_ELEVATION_ERROR_RAD = float(np.radians(1.0))
"""A point whose elevation differs by more from that of the strongest surface in its pixel is hidden by it."""
BORDER_PX = 2
"""No point is drawn nearer to the border of an image."""


@dataclass(frozen=True)
class TrueTracks:
    """Exact observations of points in consecutive frames, sorted by track and frame."""

    track: IntArray
    """(O,)"""
    frame: IntArray
    """(O,)"""
    range_m: FloatArray
    """(O,) of the projected point."""
    bearing_rad: FloatArray
    """(O,) of the projected point."""

    def write(self, path: Path) -> None:
        """Write the tracks as a NumPy archive."""
        np.savez(path, **vars(self))

    @classmethod
    def read(cls, path: Path) -> "TrueTracks":
        """Read tracks that were written."""
        with np.load(path, allow_pickle=False) as file:
            return cls(**{name: file[name] for name in cls.__dataclass_fields__})


def find_true_tracks(
    world_from_sonar: FloatArray,
    sonar: SonarModel,
    read_truth: Callable[[int], FrameTruth],
    points: int,
    rng: np.random.Generator,
) -> TrueTracks:
    """Draw points on the visible surfaces and follow each until it is hidden or leaves the image.

    Args:
        world_from_sonar: (N, 4, 4) true poses of the frames.
        sonar: pixel grid and aperture.
        read_truth: returns the true elevations of a frame.
        points: number of points in view of every frame, as far as its surfaces provide pixels for them.
        rng: draws the points.
    """
    xyz_m, track = np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
    count, rows = 0, []
    for frame, pose in enumerate(world_from_sonar):
        elevation_rad = read_truth(frame).elevation_rad
        seen = _find_seen(transform(invert(pose), xyz_m), sonar, elevation_rad)
        drawn_m = _draw_points(elevation_rad, sonar, points - int(seen.sum()), rng)
        new = count + np.arange(len(drawn_m))
        xyz_m = np.concatenate([xyz_m[seen], transform(pose, drawn_m)])
        track, count = np.concatenate([track[seen], new]), count + len(drawn_m)
        range_m, bearing_rad, _ = project(transform(invert(pose), xyz_m))
        rows.append((track, np.full(len(track), frame), range_m, bearing_rad))
    columns = [np.concatenate(column) for column in zip(*rows, strict=True)]
    order = np.lexsort((columns[1], columns[0]))
    return TrueTracks(*(column[order] for column in columns))


def _find_seen(in_sonar_m: FloatArray, sonar: SonarModel, elevation_rad: FloatArray) -> BoolArray:
    """Return which (P,) of (P, 3) points are in view and not hidden."""
    range_m, bearing_rad, point_rad = project(in_sonar_m)
    row_column = np.stack([sonar.row_at_range(range_m), sonar.column_at_bearing(bearing_rad)], axis=1)
    surface_rad, known = look_up_elevation(row_column, elevation_rad)
    near = np.abs(point_rad - surface_rad) <= MAX_ELEVATION_ERROR_RAD
    return np.asarray(sonar.sees(in_sonar_m) & known & near)


def _draw_points(elevation_rad: FloatArray, sonar: SonarModel, count: int, rng: np.random.Generator) -> FloatArray:
    """Draw (D, 3) points of the sonar frame at the centres of pixels with an echo, each pixel at most once."""
    inner = np.zeros(elevation_rad.shape, dtype=bool)
    inner[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX] = True
    row, column = np.nonzero(inner & np.isfinite(elevation_rad))
    chosen = rng.permutation(len(row))[: max(count, 0)]
    row, column = row[chosen], column[chosen]
    return back_project(sonar.range_m[row], sonar.bearing_rad[column], elevation_rad[row, column].astype(float))
