"""Observation selection: at most a given number of each track, its ends, and the smallest sigma of each section."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from asfm.backend.estimation.observation_selection import cap_observations
from asfm.types import FloatArray, Tracks


def make_tracks(lengths: list[int]) -> Tracks:
    track = np.repeat(np.arange(len(lengths)), lengths)
    frame = np.concatenate([np.arange(length) for length in lengths])
    return Tracks(track, frame, np.full(len(track), 3.0), np.zeros(len(track)))


def draw_sigma(tracks: Tracks, rng: np.random.Generator) -> FloatArray:
    return np.asarray(rng.uniform(0.5, 2.0, (len(tracks), 1)) * np.array([0.01, 0.005]))


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers(1, 60), min_size=1, max_size=6), st.integers(3, 20), st.integers(0, 99))
def test_tracks_are_capped_and_keep_their_ends(lengths: list[int], max_views: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    tracks = make_tracks(lengths)
    observed = rng.random(len(tracks)) < 0.8
    kept = cap_observations(tracks, observed, draw_sigma(tracks, rng), max_views)
    assert not (kept & ~observed).any()
    for number in range(len(lengths)):
        used, left = (np.flatnonzero(which & (tracks.track == number)) for which in (observed, kept))
        assert len(left) == min(len(used), max_views)
        if len(used):
            assert {used[0], used[-1]} <= set(left)


def test_each_section_keeps_the_view_with_the_smallest_sigma() -> None:
    tracks = make_tracks([102])
    sigma = np.tile([0.01, 0.005], (102, 1))
    sharp = np.arange(4, 102, 10)
    sigma[sharp] *= 0.5
    kept = np.flatnonzero(cap_observations(tracks, np.ones(102, dtype=bool), sigma, 12))
    np.testing.assert_array_equal(kept, [0, *sharp, 101])


def test_the_selection_does_not_depend_on_the_units_of_range_and_bearing() -> None:
    rng, tracks = np.random.default_rng(0), make_tracks([60, 40])
    sigma, observed = rng.uniform(0.5, 2.0, (len(tracks), 2)), np.ones(len(tracks), dtype=bool)
    in_mm_and_deg = sigma * [1000.0, 180 / np.pi]
    kept = cap_observations(tracks, observed, sigma, 10)
    np.testing.assert_array_equal(cap_observations(tracks, observed, in_mm_and_deg, 10), kept)


def test_without_candidates_nothing_is_kept() -> None:
    tracks = make_tracks([5])
    assert not cap_observations(tracks, np.zeros(5, dtype=bool), np.ones((5, 2)), 3).any()
