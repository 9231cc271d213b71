"""Track building: the invariants of Tracks, and equality with a plain merging of sets."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asfm.frontend.tracking.track_builder import build_tracks, share_changed
from asfm.types import Keypoints, Matches, Tracks
from tests.worlds import make_keypoints

Node = tuple[int, int]
"""(frame, keypoint)"""


def numbered_keypoints(counts: list[int]) -> list[Keypoints]:
    """Make keypoints whose range encodes frame and index, frame + keypoint / 1000; their bearing is minus that."""
    codes = [frame + np.arange(count) / 1000 for frame, count in enumerate(counts)]
    return [make_keypoints(code, -code) for code in codes]


@dataclass(frozen=True)
class Case:
    """Numbers of keypoints of each frame, and matches of them."""

    counts: list[int]
    matches: list[Matches]

    @property
    def keypoints(self) -> list[Keypoints]:
        return numbered_keypoints(self.counts)


def make_case(seed: int, frames: int, max_keypoints: int, density: float, distinct: bool = True) -> Case:
    """Draw random matches between all pairs of frames, with distinct costs or with ties."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, max_keypoints + 1, frames).tolist()
    index = []
    for a in range(frames):
        for b in range(a + 1, frames):
            pairs = np.argwhere(rng.random((counts[a], counts[b])) < density)
            index.append((a, b, pairs.astype(np.int64)))
    total = sum(len(pairs) for _, _, pairs in index)
    costs = rng.permutation(total) / max(total, 1) if distinct else rng.integers(0, 3, total).astype(float)
    parts = np.split(costs, np.cumsum([len(pairs) for _, _, pairs in index])[:-1]) if index else []
    return Case(counts, [Matches(a, b, pairs, cost) for (a, b, pairs), cost in zip(index, parts, strict=True)])


CASES = st.builds(make_case, st.integers(0, 2**32 - 1), st.integers(0, 7), st.integers(0, 6), st.floats(0, 0.5))
CASES_WITH_TIES = st.builds(
    make_case, st.integers(0, 2**32 - 1), st.integers(0, 7), st.integers(0, 6), st.floats(0, 0.5), st.just(False)
)


def merge_sets(case: Case, min_views: int) -> set[frozenset[Node]]:
    """Merge sets of keypoints, cheapest match first, never two keypoints of one frame."""
    edges = [
        (cost, (match.frame_a, a), (match.frame_b, b))
        for match in case.matches
        for (a, b), cost in zip(match.index.tolist(), match.cost.tolist(), strict=True)
    ]
    group_of = {(frame, k): {(frame, k)} for frame, count in enumerate(case.counts) for k in range(count)}
    for _, a, b in sorted(edges, key=lambda edge: edge[0]):
        one, other = group_of[a], group_of[b]
        if one is other or {frame for frame, _ in one} & {frame for frame, _ in other}:
            continue
        one |= other
        for node in other:
            group_of[node] = one
    return {frozenset(group) for group in group_of.values() if len(group) >= min_views}


def members(tracks: Tracks) -> set[frozenset[Node]]:
    keypoint = np.round((tracks.range_m - tracks.frame) * 1000).astype(int)
    return {
        frozenset(zip(tracks.frame[mine].tolist(), keypoint[mine].tolist(), strict=True))
        for mine in (tracks.track == number for number in range(tracks.count))
    }


@settings(max_examples=150, deadline=None)
@given(st.one_of(CASES, CASES_WITH_TIES), st.integers(2, 4))
def test_tracks_equal_merged_sets(case: Case, min_views: int) -> None:
    assert members(build_tracks(case.keypoints, case.matches, min_views)) == merge_sets(case, min_views)


@settings(max_examples=100, deadline=None)
@given(st.one_of(CASES, CASES_WITH_TIES), st.integers(2, 4))
def test_tracks_satisfy_the_invariants_of_their_type(case: Case, min_views: int) -> None:
    tracks = build_tracks(case.keypoints, case.matches, min_views)
    track_frame = list(zip(tracks.track.tolist(), tracks.frame.tolist(), strict=True))
    assert track_frame == sorted(set(track_frame)), "sorted by (track, frame), a frame only once in a track"
    assert sorted(set(tracks.track.tolist())) == list(range(tracks.count))
    assert (np.bincount(tracks.track, minlength=1) >= (min_views if tracks.count else 0)).all()
    assert tracks.track.dtype == tracks.frame.dtype == np.int64
    assert len(tracks.range_m) == len(tracks.bearing_rad) == len(tracks)
    codes = set(tracks.range_m.tolist())
    assert len(codes) == len(tracks), "no keypoint is in two tracks"
    np.testing.assert_array_equal(np.floor(tracks.range_m + 1e-9), tracks.frame)
    np.testing.assert_array_equal(tracks.bearing_rad, -tracks.range_m)


@settings(max_examples=60, deadline=None)
@given(CASES, st.integers(0, 2**32 - 1))
def test_tracks_are_invariant_to_the_order_of_matches(case: Case, seed: int) -> None:
    rng = np.random.default_rng(seed)
    shuffled = []
    for which in rng.permutation(len(case.matches)):
        match = case.matches[which]
        order = rng.permutation(len(match))
        index, cost = match.index[order], match.cost[order]
        if rng.random() < 0.5:
            shuffled.append(Matches(match.frame_b, match.frame_a, index[:, ::-1], cost))
        else:
            shuffled.append(Matches(match.frame_a, match.frame_b, index, cost))
    assert members(build_tracks(case.keypoints, shuffled)) == members(build_tracks(case.keypoints, case.matches))


def test_the_cheaper_of_two_conflicting_matches_is_used() -> None:
    keypoints = numbered_keypoints([1, 2, 1])
    first = Matches(0, 1, np.array([[0, 0], [0, 1]]), np.array([0.5, 0.1]))
    second = Matches(1, 2, np.array([[0, 0]]), np.array([0.3]))
    assert members(build_tracks(keypoints, [first, second])) == {
        frozenset({(0, 0), (1, 1)}),
        frozenset({(1, 0), (2, 0)}),
    }


def test_a_long_chain_is_one_track() -> None:
    count = 300
    chain = [Matches(frame, frame + 1, np.array([[0, 0]]), np.array([float(frame)])) for frame in range(count - 1)]
    for matches in (chain, chain[::-1], chain[::2] + chain[1::2]):
        tracks = build_tracks(numbered_keypoints([1] * count), matches)
        np.testing.assert_array_equal(tracks.frame, np.arange(count))
        assert tracks.count == 1


@pytest.mark.parametrize("counts", [[], [0], [0, 0, 0], [3, 2]])
def test_no_matches_give_no_tracks(counts: list[int]) -> None:
    nothing = [Matches(0, 1, np.zeros((0, 2), dtype=np.int64), np.zeros(0))] if len(counts) > 1 else []
    for matches in ([], nothing):
        tracks = build_tracks(numbered_keypoints(counts), matches)
        assert (len(tracks), tracks.count) == (0, 0)
        assert [array.shape for array in (tracks.track, tracks.frame, tracks.range_m, tracks.bearing_rad)] == [(0,)] * 4


@pytest.mark.parametrize("seed", range(5))
def test_sigma_is_the_median_over_the_matches_of_a_keypoint(seed: int) -> None:
    case = make_case(seed, 6, 6, 0.3)
    rng = np.random.default_rng(seed)
    matches = [replace(match, sigma=rng.random((len(match), 2))) for match in case.matches]
    tracks = build_tracks(case.keypoints, matches)
    assert tracks.sigma is not None and len(tracks.sigma) == len(tracks) > 0
    for frame, range_m, sigma in zip(tracks.frame, tracks.range_m, tracks.sigma, strict=True):
        keypoint = round((range_m - frame) * 1000)
        own = [
            match.sigma[match.index[:, side] == keypoint]
            for match in matches
            for side, at in enumerate((match.frame_a, match.frame_b))
            if at == frame and match.sigma is not None
        ]
        stated = np.sort(np.concatenate(own), axis=0)
        assert sigma.tolist() == stated[len(stated) // 2].tolist()


def test_sigma_is_none_if_any_match_states_none() -> None:
    case = make_case(0, 5, 5, 0.4)
    assert build_tracks(case.keypoints, case.matches).sigma is None
    some = [replace(case.matches[0], sigma=np.ones((len(case.matches[0]), 2))), *case.matches[1:]]
    assert build_tracks(case.keypoints, some).sigma is None


def make_tracks(rng: np.random.Generator, count: int) -> Tracks:
    """Make tracks of three observations each, of distinct keypoints."""
    keypoint = np.repeat(rng.choice(2**40, count, replace=False), 3)
    track, frame = np.repeat(np.arange(count), 3), np.tile(np.arange(3), count)
    return Tracks(track, frame, rng.random(3 * count), rng.random(3 * count), keypoint=keypoint)


@pytest.mark.parametrize("seed", range(3))
def test_share_changed_counts_observations_whatever_the_track_numbers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tracks, other = make_tracks(rng, 20), make_tracks(rng, 20)
    used, fewer = np.ones(60, dtype=bool), np.arange(60) < 45
    assert share_changed(tracks, used, tracks, used) == 0
    assert share_changed(tracks, used, other, used) == 1
    assert share_changed(tracks, used, tracks, fewer) == share_changed(tracks, fewer, tracks, used) == 0.25
    order = np.argsort(19 - tracks.track, kind="stable")
    assert tracks.keypoint is not None
    renumbered = replace(tracks, frame=tracks.frame[order], keypoint=tracks.keypoint[order])
    assert share_changed(tracks, used, renumbered, used) == 0
    assert share_changed(tracks, ~used, tracks, ~used) == 0


def test_keypoints_of_observations_are_right_where_two_coincide() -> None:
    """Keypoints 0 and 1 of each of three frames coincide; only keypoint 1 is matched."""
    frame = make_keypoints(np.array([3.0, 3.0, 8.0]), np.array([0.4, 0.4, 0.9]))
    matches = [Matches(a, a + 1, np.array([[1, 1]]), np.zeros(1)) for a in range(2)]
    tracks = build_tracks([frame] * 3, matches)
    assert tracks.keypoint is not None
    assert (tracks.frame.tolist(), tracks.keypoint.tolist()) == ([0, 1, 2], [1, 1, 1])
    assert tracks.select(tracks.frame > 0).keypoint is not None


@pytest.mark.parametrize("seed", range(3))
def test_observations_have_the_pixels_of_their_keypoints(seed: int) -> None:
    case = make_case(seed, 5, 5, 0.4)
    tracks = build_tracks(case.keypoints, case.matches)
    assert tracks.keypoint is not None and len(tracks)
    for frame, keypoint, range_m, bearing_rad in zip(
        tracks.frame, tracks.keypoint, tracks.range_m, tracks.bearing_rad, strict=True
    ):
        assert (range_m, bearing_rad) == tuple(case.keypoints[frame].range_bearing[keypoint])
