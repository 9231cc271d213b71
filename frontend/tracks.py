"""Tracks: matches of many pairs of frames joined, best first, with never two observations in one frame."""

from collections.abc import Sequence

import numpy as np

from asfm.types import FloatArray, IntArray, Keypoints, Matches, Tracks


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
    return Tracks(
        track=track.astype(np.int64),
        frame=frame_of[node].astype(np.int64),
        range_m=_gather([frame.range_m for frame in keypoints])[node],
        bearing_rad=_gather([frame.bearing_rad for frame in keypoints])[node],
        sigma=_typical_sigma(matches, offset)[node] if _all_aligned(matches) else None,
    )


def _all_aligned(matches: Sequence[Matches]) -> bool:
    return bool(matches) and all(match.sigma is not None for match in matches if len(match))


def _typical_sigma(matches: Sequence[Matches], offset: IntArray) -> FloatArray:
    """Give every keypoint's (2,) sigma, the median over its matches; infinite where it has none."""
    sigma = np.full((int(offset[-1]), 2), np.inf)
    filled = [match for match in matches if match.sigma is not None and len(match)]
    if not filled:
        return sigma
    node = np.concatenate(
        [side for match in filled for side in (match.index + offset[[match.frame_a, match.frame_b]]).T]
    )
    stated = np.concatenate([match.sigma for match in filled for _ in range(2) if match.sigma is not None])
    for axis in range(2):
        order = np.lexsort((stated[:, axis], node))
        found, first, count = np.unique(node[order], return_index=True, return_counts=True)
        sigma[found, axis] = stated[order[first + count // 2], axis]
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
