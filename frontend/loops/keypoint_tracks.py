"""Track lookup by keypoint, and conflicts: matches that join landmarks observed apart in one frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from asfm.config import NoiseConfig
from asfm.geometry.feature_noise import difference_sigma
from asfm.geometry.poses import angle_difference
from asfm.geometry.sonar import SonarModel
from asfm.types import BoolArray, IntArray, Keypoints, Matches, Tracks

MIN_SEPARATION_SIGMAS = 4.0
"""Observations in one frame that are further apart than this are of two landmarks."""


@dataclass(frozen=True)
class KeypointTracks:
    """Tracks of a sequence, indexed by keypoint."""

    tracks: Tracks
    keypoints: Sequence[Keypoints]
    sonar: SonarModel
    noise: NoiseConfig
    observed: BoolArray
    """(O,) the observations to use, inliers of the graph."""

    def find(self, frame: int, index: IntArray) -> IntArray:
        """Return the tracks (M,) of the keypoints of a frame with (M,) indices; -1 where a keypoint has none."""
        return self._track_of_keypoint[frame][index]

    def share_conflicts(self, matches: Matches) -> float:
        """Return the share of the matches that join two landmarks observed apart in one frame.

        Only matches whose keypoints both have a track count; 0 without any.
        """
        track_a = self.find(matches.frame_a, matches.index[:, 0])
        track_b = self.find(matches.frame_b, matches.index[:, 1])
        both = (track_a >= 0) & (track_b >= 0)
        if not both.any():
            return 0.0
        conflicts = [
            self._observed_apart(a, b) for a, b in zip(track_a[both].tolist(), track_b[both].tolist(), strict=True)
        ]
        return float(np.mean(conflicts))

    def _observed_apart(self, track_a: int, track_b: int) -> bool:
        """Return whether two tracks are apart in the frames that observe both, by the median; false without any."""
        if track_a == track_b:
            return False
        a, b = (np.arange(self._start[track], self._start[track + 1]) for track in (track_a, track_b))
        _, in_a, in_b = np.intersect1d(self.tracks.frame[a], self.tracks.frame[b], return_indices=True)
        if not len(in_a):
            return False
        a, b = a[in_a], b[in_b]
        sigma = difference_sigma(self.sonar, self.noise)
        range_sigmas = (self.tracks.range_m[a] - self.tracks.range_m[b]) / sigma[0]
        bearing_sigmas = angle_difference(self.tracks.bearing_rad[a], self.tracks.bearing_rad[b]) / sigma[1]
        return bool(np.median(np.hypot(range_sigmas, bearing_sigmas)) > MIN_SEPARATION_SIGMAS)

    @cached_property
    def _track_of_keypoint(self) -> list[IntArray]:
        """Track (K,) of each keypoint, one array per frame; -1 where it has none."""
        assert self.tracks.keypoint is not None, "these tracks were made from keypoints"
        tracks = [np.full(len(frame), -1, dtype=np.int64) for frame in self.keypoints]
        for of_keypoint, observations in zip(tracks, self.tracks.by_frame(len(tracks), self.observed), strict=True):
            of_keypoint[self.tracks.keypoint[observations]] = self.tracks.track[observations]
        return tracks

    @cached_property
    def _start(self) -> IntArray:
        """First observation (T + 1,) of each track, and the number of observations."""
        return np.asarray(np.searchsorted(self.tracks.track, np.arange(self.tracks.count + 1)), dtype=np.int64)
