"""Tracks: matches of many pairs of frames joined, best first, with never two observations in one frame."""

from collections.abc import Sequence

import numpy as np

from asfm.types import BoolArray, FloatArray, IntArray, Keypoints, Matches, Tracks


def build_tracks(keypoints: Sequence[Keypoints], matches: Sequence[Matches], min_views: int = 2) -> Tracks:
    """Join matches into tracks, cheapest match first.

    A match that would put two keypoints of one frame into a track is dropped: one of the two must be wrong, and the
    cheaper match came first.

    Args:
        keypoints: those of every frame of the sequence.
        matches: of any pairs of frames.
        min_views: shorter tracks are left out.
    """
    offset = np.concatenate([[0], np.cumsum([len(frame) for frame in keypoints])]).astype(np.int64)
    pairs, cost = _stack_matches(matches, offset)
    frame_of = np.repeat(np.arange(len(keypoints)), np.diff(offset))
    group = _join(pairs[np.argsort(cost, kind="stable")], frame_of)
    members = np.bincount(group, minlength=len(group)) if len(group) else np.zeros(0, dtype=np.int64)
    node = np.flatnonzero(members[group] >= min_views) if len(group) else np.zeros(0, dtype=np.int64)
    order = np.lexsort((frame_of[node], group[node]))
    node = node[order]
    _, track = np.unique(group[node], return_inverse=True)
    sigma = _gather_sigma(matches, len(frame_of), offset)
    return Tracks(
        track=track.astype(np.int64),
        frame=frame_of[node].astype(np.int64),
        range_m=_gather([frame.range_m for frame in keypoints])[node],
        bearing_rad=_gather([frame.bearing_rad for frame in keypoints])[node],
        sigma=None if sigma is None else sigma[node],
        keypoint=node - offset[frame_of[node]],
    )


def share_changed(before: Tracks, used_before: BoolArray, after: Tracks, used_after: BoolArray) -> float:
    """Tell which share of the observations used before or after is used only once, 0 to 1; 0 where there are none.

    It does not matter which tracks they belong to: numbers of tracks mean nothing beyond one association.

    Args:
        before, after: tracks of two rounds.
        used_before, used_after: (O,) their observations that entered the graph.
    """
    places = [_used_keypoints(before, used_before), _used_keypoints(after, used_after)]
    either = len(np.unique(np.concatenate(places), axis=0))
    both = len(places[0]) + len(places[1]) - either
    return (either - both) / either if either else 0.0


def _used_keypoints(tracks: Tracks, used: BoolArray) -> IntArray:
    """Return the (K, 2) frame and keypoint of the observations used, each once."""
    assert tracks.keypoint is not None, "these tracks were made from keypoints"
    return np.unique(np.stack([tracks.frame[used], tracks.keypoint[used]], axis=1), axis=0)


def _gather_sigma(matches: Sequence[Matches], count: int, offset: IntArray) -> FloatArray | None:
    """Give each of the keypoints its (2,) sigma, the median over its matches; None where matches state none."""
    filled = [match for match in matches if len(match)]
    stated = [match.sigma for match in filled if match.sigma is not None]
    if not filled or len(stated) < len(filled):
        return None
    node = np.concatenate([match.index + offset[[match.frame_a, match.frame_b]] for match in filled]).T.ravel()
    both = np.tile(np.concatenate(stated), (2, 1))
    sigma = np.full((count, 2), np.inf)
    for axis in range(2):
        order = np.lexsort((both[:, axis], node))
        found, first, matched = np.unique(node[order], return_index=True, return_counts=True)
        sigma[found, axis] = both[order[first + matched // 2], axis]
    return sigma


def _stack_matches(matches: Sequence[Matches], offset: IntArray) -> tuple[IntArray, FloatArray]:
    """Number keypoints through the whole sequence: (M, 2) node pairs and (M,) costs."""
    if not matches:
        return np.zeros((0, 2), dtype=np.int64), np.zeros(0)
    pairs = [match.index + offset[[match.frame_a, match.frame_b]] for match in matches]
    return np.concatenate(pairs), np.concatenate([match.cost for match in matches])


def _join(pairs: IntArray, frame_of: IntArray) -> IntArray:
    """Union-find in the order given; the frames of a group are the bits of one integer, so a clash is one AND."""
    parent = list(range(len(frame_of)))
    frames = [1 << frame for frame in frame_of.tolist()]
    for a, b in pairs.tolist():
        while parent[a] != a:
            parent[a] = parent[parent[a]]
            a = parent[a]
        while parent[b] != b:
            parent[b] = parent[parent[b]]
            b = parent[b]
        if a != b and not frames[a] & frames[b]:
            parent[b] = a
            frames[a] |= frames[b]
    return _roots(np.array(parent, dtype=np.int64))


def _roots(parent: IntArray) -> IntArray:
    while True:
        grandparent = parent[parent]
        if np.array_equal(grandparent, parent):
            return parent
        parent = grandparent


def _gather(values: list[FloatArray]) -> FloatArray:
    return np.concatenate(values) if values else np.zeros(0)
