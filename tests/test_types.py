"""Data types: tracks by frame and their spans, against plain loops."""

import numpy as np
import pytest

from asfm.types import Tracks


def random_tracks(seed: int) -> Tracks:
    rng = np.random.default_rng(seed)
    sights = np.array([[t, f] for t in range(12) for f in range(9) if rng.random() < 0.5 or f == t % 9])
    track, frame = sights.T
    return Tracks(track, frame, np.ones(len(track)), np.zeros(len(track)))


@pytest.mark.parametrize("seed", range(3))
def test_observations_by_frame(seed: int) -> None:
    tracks = random_tracks(seed)
    chosen = np.random.default_rng(seed).random(len(tracks)) < 0.7
    for frame, (every, some) in enumerate(zip(tracks.by_frame(9), tracks.by_frame(9, chosen), strict=True)):
        assert every.tolist() == [i for i, f in enumerate(tracks.frame) if f == frame]
        assert some.tolist() == [i for i in every if chosen[i]]
    assert [len(part) for part in tracks.by_frame(11)[9:]] == [0, 0]


@pytest.mark.parametrize("seed", range(3))
def test_frame_span(seed: int) -> None:
    tracks = random_tracks(seed)
    chosen = (np.random.default_rng(seed).random(len(tracks)) < 0.6) & (tracks.track != 5)
    for mask, used in ((None, np.ones(len(tracks), dtype=bool)), (chosen, chosen)):
        first, last = tracks.frame_span(mask)
        for track in range(tracks.count):
            frames = tracks.frame[used & (tracks.track == track)]
            assert (first[track], last[track]) == ((frames.min(), frames.max()) if len(frames) else (0, 0))
