"""Track building: matches of many frame pairs joined by union-find, with at most one observation per frame."""

from collections.abc import Sequence

import numpy as np

from asfm.types import BoolArray, FloatArray, IntArray, Keypoints, Matches, Tracks


def build_tracks(keypoints: Sequence[Keypoints], matches: Sequence[Matches], min_views: int = 2) -> Tracks:
    """Join matches into tracks, cheapest match first.

    A match that would put two keypoints of one frame into a track is skipped: one of the two must be wrong.

    Args:
        keypoints: those of every frame of the sequence.
        matches: of any pairs of frames.
        min_views: fewest observations of a track.
    """
    offset = np.concatenate([[0], np.cumsum([len(frame) for frame in keypoints])]).astype(np.int64)
    pairs, cost = _stack_matches(matches, offset)
    frame_of = np.repeat(np.arange(len(keypoints)), np.diff(offset))
    group = _union_find(pairs[np.argsort(cost, kind="stable")], frame_of)
    members = np.bincount(group, minlength=len(group)) if len(group) else np.zeros(0, dtype=np.int64)
    node = np.flatnonzero(members[group] >= min_views) if len(group) else np.zeros(0, dtype=np.int64)
    order = np.lexsort((frame_of[node], group[node]))
    node = node[order]
    _, track = np.unique(group[node], return_inverse=True)
    sigma = _keypoint_sigma(matches, len(frame_of), offset)
    return Tracks(
        track=track.astype(np.int64),
        frame=frame_of[node].astype(np.int64),
        range_m=_concatenate([frame.range_m for frame in keypoints])[node],
        bearing_rad=_concatenate([frame.bearing_rad for frame in keypoints])[node],
        sigma=None if sigma is None else sigma[node],
        keypoint=node - offset[frame_of[node]],
    )


def share_changed(before: Tracks, used_before: BoolArray, after: Tracks, used_after: BoolArray) -> float:
    """Return the share of changed observations between two rounds: those used in only one of them, of those in either.

    Observations are compared by keypoint, since track numbers differ between associations.

    Args:
        before: tracks of the first round.
        used_before: (O,) which of their observations are in the graph.
        after: tracks of the second round.
        used_after: (O,) which of their observations are in the graph.

    Returns:
        The share, 0..1; 0 without observations.
    """
    used = [_used_keypoints(before, used_before), _used_keypoints(after, used_after)]
    either = len(np.unique(np.concatenate(used), axis=0))
    both = len(used[0]) + len(used[1]) - either
    return (either - both) / either if either else 0.0


def _used_keypoints(tracks: Tracks, used: BoolArray) -> IntArray:
    """Return the unique frame and keypoint (K, 2) of the used observations."""
    assert tracks.keypoint is not None, "these tracks were made from keypoints"
    return np.unique(np.stack([tracks.frame[used], tracks.keypoint[used]], axis=1), axis=0)


def _keypoint_sigma(matches: Sequence[Matches], count: int, offset: IntArray) -> FloatArray | None:
    """Return the median standard deviations (K, 2) over each keypoint's matches; None if any matches have none."""
    filled = [match for match in matches if len(match)]
    stated = [match.sigma for match in filled if match.sigma is not None]
    if not filled or len(stated) < len(filled):
        return None
    node = np.concatenate([match.index + offset[[match.frame_a, match.frame_b]] for match in filled]).T.ravel()
    of_node = np.tile(np.concatenate(stated), (2, 1))
    sigma = np.full((count, 2), np.inf)
    for axis in range(2):
        order = np.lexsort((of_node[:, axis], node))
        found, first, matched = np.unique(node[order], return_index=True, return_counts=True)
        sigma[found, axis] = of_node[order[first + matched // 2], axis]
    return sigma


def _stack_matches(matches: Sequence[Matches], offset: IntArray) -> tuple[IntArray, FloatArray]:
    """Return the matches as (M, 2) pairs of nodes, keypoints numbered through the sequence, and their (M,) costs."""
    if not matches:
        return np.zeros((0, 2), dtype=np.int64), np.zeros(0)
    pairs = [match.index + offset[[match.frame_a, match.frame_b]] for match in matches]
    return np.concatenate(pairs), np.concatenate([match.cost for match in matches])


def _union_find(pairs: IntArray, frame_of: IntArray) -> IntArray:
    """Return the root node (K,) of each node; the frames of a group are the bits of an integer, to compare with AND."""
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
    """Return the root (K,) of each node by path doubling."""
    while True:
        grandparent = parent[parent]
        if np.array_equal(grandparent, parent):
            return parent
        parent = grandparent


def _concatenate(values: list[FloatArray]) -> FloatArray:
    return np.concatenate(values) if values else np.zeros(0)
