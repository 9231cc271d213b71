"""Which landmark a keypoint shows, as far as the tracks know, and what no landmark can be."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from asfm.config import NoiseConfig
from asfm.frontend.matching.filters import difference_sigma
from asfm.frontend.tracking.track_builder import key_places, observations_by_frame
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
        of_frame = self._by_frame[frame]
        keys = key_places(self.tracks.range_m[of_frame], self.tracks.bearing_rad[of_frame])
        order = np.argsort(keys)
        wanted = key_places(self.keypoints[frame].range_m[which], self.keypoints[frame].bearing_rad[which])
        if not len(keys):
            return np.full(len(which), -1)
        place = order[np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)]
        return np.where(keys[place] == wanted, self.tracks.track[of_frame[place]], -1)

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
    def _by_frame(self) -> list[IntArray]:
        return observations_by_frame(self.tracks, len(self.keypoints), self.observed)

    @cached_property
    def _start(self) -> IntArray:
        return np.asarray(np.searchsorted(self.tracks.track, np.arange(self.tracks.count + 1)), dtype=np.int64)
