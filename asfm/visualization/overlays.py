"""Overlays on sonar images: matches and tracks as line segments in pixels of the fan or the polar image."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray, IntArray, Keypoints, Matches, Tracks
from asfm.visualization.colours import ARC_IN_VIEW, MATCH, REJECTED
from asfm.visualization.pictures import Picture

HIDDEN = tuple(f"{view}/rejected/{name}" for view in ("fan", "polar") for name in ("ratio", "mutual"))
"""Entities hidden at first: these filters reject most candidates, which would cover the picture."""


class Grid(Protocol):
    """Pixel grid that sonar images are drawn on, such as a fan."""

    def pixel_at(self, range_m: FloatArray, bearing_rad: FloatArray) -> FloatArray:
        """Return (..., 2) fractional column and row of range and bearing."""

    def draw(self, image: Picture) -> Picture:
        """Resample a (ranges, beams) image onto the grid."""


@dataclass(frozen=True)
class PolarGrid:
    """The pixel grid of the polar image itself."""

    sonar: SonarModel

    def pixel_at(self, range_m: FloatArray, bearing_rad: FloatArray) -> FloatArray:
        """Return (..., 2) fractional column and row of range and bearing."""
        return np.stack([self.sonar.column_at_bearing(bearing_rad), self.sonar.row_at_range(range_m)], axis=-1)

    def draw(self, image: Picture) -> Picture:
        """Return the polar image unchanged."""
        return image


def group_matches(matches: Matches) -> dict[str, tuple[IntArray, dict[str, Any]]]:
    """Group the matches of two frames by the filter that rejected them.

    Returns:
        By entity name ("matches" for the accepted ones), (M, 2) keypoint indices, and colours and labels for Rerun.
    """
    groups: dict[str, tuple[IntArray, dict[str, Any]]] = {"matches": (matches.index, {"colors": MATCH})}
    for number, name in enumerate(matches.filters):
        index = matches.rejected[matches.rejected_by == number].astype(np.int64)
        label = {"labels": [f"rejected by {name}"] * len(index), "show_labels": False}
        groups[f"rejected/{name}"] = index, {"colors": REJECTED.get(name, ARC_IN_VIEW), **label}
    return groups


def build_match_segments(grid: Grid, frame_a: Keypoints, frame_b: Keypoints, index: IntArray) -> FloatArray:
    """Return (M, 2, 2) pixels of both keypoints of (M, 2) matches, as segments from frame a to frame b."""
    ends = zip((frame_a, frame_b), index.T, strict=True)
    return np.stack([grid.pixel_at(found.range_m[which], found.bearing_rad[which]) for found, which in ends], axis=1)


def build_track_segments(tracks: Tracks, xy_px: FloatArray) -> FloatArray:
    """Return segments from the previous observation of a track to each one; the first has length zero.

    Args:
        tracks: (O,) observations.
        xy_px: (O, 2) their pixels.

    Returns:
        (O, 2, 2) pixels of both ends.
    """
    here = np.arange(len(tracks))
    before = np.maximum(here - 1, 0)
    return np.stack([xy_px[np.where(tracks.track[before] == tracks.track, before, here)], xy_px], axis=1)
