"""Track lookup by keypoint and share of conflicting matches, against plain loops and hand-made tracks."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.config import NoiseConfig
from asfm.frontend.loops.keypoint_tracks import MIN_SEPARATION_SIGMAS, KeypointTracks
from asfm.geometry.feature_noise import difference_sigma
from asfm.geometry.sonar import SonarModel
from asfm.types import BoolArray, Matches, Tracks
from tests.worlds import make_keypoints

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.6, 0.6), (600, 256), 0.3)
NOISE = NoiseConfig()
FRAMES, KEYPOINTS = 6, 8


def index_tracks(tracks: Tracks, observed: BoolArray | None = None) -> KeypointTracks:
    keypoints = [make_keypoints(np.full(KEYPOINTS, 3.0), np.zeros(KEYPOINTS)) for _ in range(FRAMES)]
    used = np.ones(len(tracks), dtype=bool) if observed is None else observed
    return KeypointTracks(tracks, keypoints, SONAR, NOISE, used)


def make_tracks(observations: list[tuple[int, int, int, float, float]]) -> Tracks:
    """Make tracks of (track, frame, keypoint, range, bearing), range and bearing in sigmas from 3 m and zero."""
    track, frame, keypoint = np.array([row[:3] for row in observations], dtype=np.int64).T
    pixel = np.array([row[3:] for row in observations]) * difference_sigma(SONAR, NOISE) + [3.0, 0.0]
    return Tracks(track, frame, pixel[:, 0], pixel[:, 1], keypoint=keypoint)


def make_matches(*pairs: tuple[int, int]) -> Matches:
    """Match keypoints of frames 0 and 5."""
    return Matches(0, 5, np.array(pairs, dtype=np.int64).reshape(-1, 2), np.zeros(len(pairs)))


@pytest.mark.parametrize("seed", range(5))
def test_find_equals_a_search_of_all_observations(seed: int) -> None:
    """All keypoints of a frame coincide, so that they differ in their index alone."""
    rng = np.random.default_rng(seed)
    label = np.array([rng.permutation(2 * KEYPOINTS)[:KEYPOINTS] for _ in range(FRAMES)])
    frame, keypoint = (value.ravel() for value in np.indices(label.shape))
    order = np.lexsort((frame, label.ravel()))
    _, track = np.unique(label.ravel()[order], return_inverse=True)
    frame, keypoint = frame[order], keypoint[order]
    tracks = Tracks(track, frame, np.full(len(track), 3.0), np.zeros(len(track)), keypoint=keypoint)
    observed = rng.random(len(tracks)) < 0.7
    indexed = index_tracks(tracks, observed)
    which = rng.integers(0, KEYPOINTS, 20)
    expected = np.full((FRAMES, 20), -1)
    for number, row in enumerate(expected):
        for at, wanted in enumerate(which):
            hit = np.flatnonzero((frame == number) & (keypoint == wanted) & observed)
            row[at] = track[hit[0]] if len(hit) else -1
        np.testing.assert_array_equal(indexed.find(number, which), row)
    assert 0 < np.mean(expected < 0) < 0.5


def two_tracks(*apart: tuple[float, float]) -> KeypointTracks:
    """Index track 0 (keypoint 0 of frame 0) and 1 (keypoint 1 of frame 5), apart by some sigmas in frames 1, 2, ..."""
    first = [(0, 0, 0, 0.0, 0.0), *((0, frame, 0, 0.0, 0.0) for frame in range(1, len(apart) + 1))]
    second = [*((1, frame, 1, *offset) for frame, offset in enumerate(apart, 1)), (1, 5, 1, 0.0, 0.0)]
    return index_tracks(make_tracks([*first, *second]))


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, -1.0), (-0.6, 0.8)])
@pytest.mark.parametrize(("scale", "share"), [(0.99, 0.0), (1.01, 1.0)])
def test_landmarks_observed_apart_in_one_frame_conflict(
    direction: tuple[float, float], scale: float, share: float
) -> None:
    offset = (scale * MIN_SEPARATION_SIGMAS * direction[0], scale * MIN_SEPARATION_SIGMAS * direction[1])
    assert two_tracks(offset).share_conflicts(make_matches((0, 1))) == share


def test_the_median_over_common_frames_decides() -> None:
    far, near = (9.0, 0.0), (1.0, 0.0)
    assert two_tracks(far, near, near).share_conflicts(make_matches((0, 1))) == 0.0
    assert two_tracks(far, near, far).share_conflicts(make_matches((0, 1))) == 1.0


def test_landmarks_without_a_common_frame_do_not_conflict() -> None:
    assert two_tracks().share_conflicts(make_matches((0, 1))) == 0.0


def test_only_matches_with_two_tracks_count() -> None:
    """Keypoints of tracks 0 (both frames), 1 and 2 (apart in frame 3); keypoints 6 and 7 have no track."""
    tracks = make_tracks(
        [
            (0, 0, 0, 0.0, 0.0),
            (0, 5, 0, 0.0, 0.0),
            (1, 0, 1, 0.0, 0.0),
            (1, 3, 1, 0.0, 0.0),
            (2, 3, 2, 20.0, 0.0),
            (2, 5, 2, 0.0, 0.0),
        ]
    )
    indexed = index_tracks(tracks)
    assert indexed.share_conflicts(make_matches((0, 0), (1, 2))) == 0.5
    assert indexed.share_conflicts(make_matches((0, 0), (1, 2), (6, 7), (6, 2), (1, 7))) == 0.5
    assert indexed.share_conflicts(make_matches((0, 0), (6, 7))) == 0.0
    assert indexed.share_conflicts(make_matches((6, 7))) == 0.0
    assert indexed.share_conflicts(make_matches()) == 0.0


def test_landmarks_on_both_sides_of_the_cut_behind_the_sonar_do_not_conflict() -> None:
    """One has a bearing near pi, the other near -pi: they are a sigma apart."""
    indexed = two_tracks((0.0, 0.0))
    side = np.where(indexed.tracks.track == 0, 1, -1)
    astern_rad = side * (np.pi - 0.5 * difference_sigma(SONAR, NOISE)[1])
    behind = replace(indexed, tracks=replace(indexed.tracks, bearing_rad=astern_rad))
    assert behind.share_conflicts(make_matches((0, 1))) == 0.0
