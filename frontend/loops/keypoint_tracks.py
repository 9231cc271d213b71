"""Which landmark a keypoint shows, as far as the tracks know, and what no landmark can be."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from asfm.config import NoiseConfig
from asfm.geometry.feature_noise import difference_sigma
from asfm.geometry.sonar import SonarModel
from asfm.types import BoolArray, IntArray, Keypoints, Matches, Tracks

APART = 4.0
"""Two observations of one frame this many sigmas apart show two points, not one point twice."""


@dataclass(frozen=True)
class KeypointTracks:
    """The tracks of a sequence, looked up by keypoint."""

    tracks: Tracks
    keypoints: Sequence[Keypoints]
    sonar: SonarModel
    noise: NoiseConfig
    observed: BoolArray
    """(O,) the observations to believe."""

    def find(self, frame: int, which: IntArray) -> IntArray:
        """Give the tracks (M,) of some keypoints of a frame; -1 where a keypoint has none."""
        return self._track_of_keypoint[frame][which]

    def share_conflicts(self, matches: Matches) -> float:
        """Tell which share of the matches joins two landmarks that some frame sees apart; 0 where nothing is known."""
        track_a = self.find(matches.frame_a, matches.index[:, 0])
        track_b = self.find(matches.frame_b, matches.index[:, 1])
        both = (track_a >= 0) & (track_b >= 0)
        if not both.any():
            return 0.0
        apart = [self._seen_apart(a, b) for a, b in zip(track_a[both].tolist(), track_b[both].tolist(), strict=True)]
        return float(np.mean(apart))

    def _seen_apart(self, track_a: int, track_b: int) -> bool:
        if track_a == track_b:
            return False
        a, b = (np.arange(self._start[track], self._start[track + 1]) for track in (track_a, track_b))
        _, in_a, in_b = np.intersect1d(self.tracks.frame[a], self.tracks.frame[b], return_indices=True)
        if not len(in_a):
            return False
        a, b = a[in_a], b[in_b]
        sigma = difference_sigma(self.sonar, self.noise)
        range_sigmas = (self.tracks.range_m[a] - self.tracks.range_m[b]) / sigma[0]
        bearing_sigmas = (self.tracks.bearing_rad[a] - self.tracks.bearing_rad[b]) / sigma[1]
        return bool(np.median(np.hypot(range_sigmas, bearing_sigmas)) > APART)

    @cached_property
    def _track_of_keypoint(self) -> list[IntArray]:
        """The track (K,) of each keypoint of each frame; -1 where it has none."""
        assert self.tracks.keypoint is not None, "these tracks were made from keypoints"
        found = [np.full(len(frame), -1, dtype=np.int64) for frame in self.keypoints]
        for of_keypoint, observations in zip(found, self.tracks.by_frame(len(found), self.observed), strict=True):
            of_keypoint[self.tracks.keypoint[observations]] = self.tracks.track[observations]
        return found

    @cached_property
    def _start(self) -> IntArray:
        return np.asarray(np.searchsorted(self.tracks.track, np.arange(self.tracks.count + 1)), dtype=np.int64)
