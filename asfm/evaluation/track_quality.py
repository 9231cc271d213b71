"""Length and purity of feature tracks."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from asfm.evaluation.true_points import find_true_points
from asfm.geometry.poses import invert
from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray, FrameTruth, Tracks


@dataclass(frozen=True)
class TrackQuality:
    """Quality of the tracks of a run."""

    tracks: int
    mean_length: float | None
    """Observations of a track; None without tracks."""
    median_length: float | None
    purity: float | None
    """Share of a track's observations that belong to its true point, mean over the tracks; None without truth.

    A track on noise, where nothing echoes, has the purity 0. The true point of a track is the one that most of its
    observations agree with (:mod:`asfm.evaluation.true_points`), so that a track of two different points has 0.5.
    """


def measure_tracks(
    tracks: Tracks,
    sonar: SonarModel,
    world_from_sonar: FloatArray | None = None,
    read_truth: Callable[[int], FrameTruth] | None = None,
) -> TrackQuality:
    """Measure length and, with the truth of a simulation, purity of tracks.

    Args:
        tracks: (O,) observations.
        sonar: pixel grid.
        world_from_sonar: (N, 4, 4) true poses of the frames.
        read_truth: returns the true elevations of a frame.

    Raises:
        AsfmError: the truth of a frame cannot be read.
    """
    if not tracks.count:
        return TrackQuality(0, None, None, None)
    length = np.bincount(tracks.track)
    purity = None
    if world_from_sonar is not None and read_truth is not None:
        truth = find_true_points(tracks, sonar, invert(world_from_sonar), read_truth)
        purity = float(np.mean(np.bincount(tracks.track, truth.inlier) / length))
    return TrackQuality(tracks.count, float(np.mean(length)), float(np.median(length)), purity)
