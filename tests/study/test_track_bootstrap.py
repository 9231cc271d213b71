"""Bootstrap over tracks: a share of them stays whole, and nothing of the others."""

import numpy as np

from asfm.frontend.tracking.track_builder import build_tracks
from asfm.study.track_bootstrap import KEPT_SHARE, resample_tracks
from asfm.types import Keypoints, Matches
from tests.worlds import make_keypoints

FRAMES, TRACKS, ALONE = 4, 400, 100


def make_tracks() -> tuple[list[Keypoints], list[Matches]]:
    """Make keypoints whose range tells their track; the last ones of every frame are in none."""
    keypoints = [make_keypoints(np.arange(1.0, TRACKS + ALONE + 1), np.zeros(TRACKS + ALONE)) for _ in range(FRAMES)]
    index = np.stack([np.arange(TRACKS), np.arange(TRACKS)], axis=1)
    sigma = np.stack([np.arange(TRACKS), np.arange(TRACKS)], axis=1).astype(float)
    return keypoints, [Matches(a, a + 1, index, index[:, 0] / 1e3, sigma=sigma) for a in range(FRAMES - 1)]


def test_tracks_are_kept_whole_or_removed() -> None:
    keypoints, matches = resample_tracks(*make_tracks(), np.random.default_rng(0))
    kept = [set(frame.range_m[frame.range_m <= TRACKS]) for frame in keypoints]
    assert all(found == kept[0] for found in kept)
    assert abs(len(kept[0]) / TRACKS - KEPT_SHARE) < 0.06
    alone = np.mean([(frame.range_m > TRACKS).sum() for frame in keypoints])
    assert abs(alone / ALONE - KEPT_SHARE) < 0.1
    tracks = build_tracks(keypoints, matches)
    assert tracks.count == len(kept[0]) and (np.bincount(tracks.track) == FRAMES).all()


def test_matches_still_join_the_same_keypoints() -> None:
    keypoints, matches = resample_tracks(*make_tracks(), np.random.default_rng(0))
    for match in matches:
        a, b = keypoints[match.frame_a].range_m[match.index[:, 0]], keypoints[match.frame_b].range_m[match.index[:, 1]]
        np.testing.assert_array_equal(a, b)
        np.testing.assert_allclose(match.cost, (a - 1) / 1e3)
        assert match.sigma is not None
        np.testing.assert_array_equal(match.sigma[:, 0], a - 1)


def test_another_generator_keeps_other_tracks() -> None:
    one, same, other = (resample_tracks(*make_tracks(), np.random.default_rng(seed))[0] for seed in (1, 1, 2))
    assert np.array_equal(one[0].range_m, same[0].range_m) and not np.array_equal(one[0].range_m, other[0].range_m)
