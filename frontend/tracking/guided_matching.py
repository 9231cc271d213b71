"""Re-matching guided by points and poses: tracks are completed where they should be seen, merged where they meet."""

from collections.abc import Sequence

import numpy as np

from asfm.frontend.matching.nearest import descriptor_distances
from asfm.frontend.tracking.triangulated_tracks import WIDENED, Prediction, SolvedTracks, predict_sightings
from asfm.types import BoolArray, Descriptors, FloatArray, IntArray, Matches

LATE = 2.0
"""Added to the cost of these matches: tracks are built from what frames say of each other first, loops included."""
ALIKE = 90
"""Percentile of the descriptors' distances along the tracks above which two are not alike."""
PAIRS = 4000
"""Steps of tracks of which that percentile is taken."""
TOGETHER = 11.3
"""Squared distance of two points, whitened by both covariances, that one point has in 99 of 100 cases (chi-square, 3
degrees of freedom)."""


def rematch(solved: SolvedTracks, window: int) -> list[Matches]:
    """Match keypoints with tracks that should be seen where they are.

    Each point with agreeing observations at most a window away is predicted into the frames that lack it. A keypoint
    inside the gate of noise and of the point's own covariance, whose descriptor is as alike as those along the tracks
    are, is matched with the track's nearest observation, where both prefer each other. If no track has the keypoint,
    this completes the track; if another has, it merges the two, provided that their points agree. Whether matches
    enter a track is up to the association: they come after all others, and never put two observations in one frame.

    Args:
        solved: a round's result.
        window: how many frames away an agreeing observation may be; 0 proposes nothing.

    Returns:
        Matches of pairs of frames; without any agreeing observations none.
    """
    limit = _measure_likeness(solved) if window else 0.0
    if limit <= 0:
        return []
    rows = [_rematch_frame(solved, frame, window, limit) for frame in range(len(solved.keypoints))]
    return _gather(solved, [row for row in rows if row is not None])


def add_matches(known: Sequence[Matches], found: Sequence[Matches]) -> list[Matches]:
    """Add matches to those known before, each pair of keypoints only once."""
    before = {_name(match, pair) for match in known for pair in match.index.tolist()}
    added = list(known)
    for match in found:
        old = np.array([_name(match, pair) in before for pair in match.index.tolist()], dtype=bool)
        if not old.all():
            kept = ~old
            sigma = None if match.sigma is None else match.sigma[kept]
            added.append(Matches(match.frame_a, match.frame_b, match.index[kept], match.cost[kept], sigma=sigma))
    return added


def _name(match: Matches, pair: Sequence[int]) -> tuple[int, int, int, int]:
    return match.frame_a, match.frame_b, pair[0], pair[1]


Row = tuple[IntArray, FloatArray, FloatArray]
"""(M, 4) frame, keypoint, other frame, its keypoint; (M,) costs; (M, 2) sigmas."""


def _rematch_frame(solved: SolvedTracks, frame: int, window: int, limit: float) -> Row | None:
    """Match the keypoints of one frame."""
    predicted, here = predict_sightings(solved, frame, window), solved.keypoints[frame]
    if not len(predicted.track) or not len(here):
        return None
    owner, sigma = _look_up(solved, frame)
    distance = descriptor_distances(_describe(solved, predicted.nearest), here.descriptors)
    distance[(distance > limit) | ~_inside_gate(solved, predicted, frame, sigma)] = np.inf
    best = distance.argmin(axis=1)
    rows = np.arange(len(best))
    good = np.isfinite(distance[rows, best]) & (distance.argmin(axis=0)[best] == rows)
    other = owner[best]
    good[good] &= (other[good] < 0) | _meet(solved, predicted.track[good], other[good])
    nearest, best = predicted.nearest[good], best[good]
    pairs = np.stack([solved.tracks.frame[nearest], solved.keypoint[nearest], np.full(len(best), frame), best], axis=1)
    return pairs, LATE + distance[rows[good], best].astype(float) / limit, sigma[best]


def _look_up(solved: SolvedTracks, frame: int) -> tuple[IntArray, FloatArray]:
    """Give the track (K,) of each keypoint of a frame, -1 where it has none, and its (K, 2) sigma."""
    count, of_frame = len(solved.keypoints[frame]), solved.by_frame[frame]
    owner, sigma = np.full(count, -1), np.tile(solved.typical, (count, 1))
    owner[solved.keypoint[of_frame]] = solved.tracks.track[of_frame]
    if solved.tracks.sigma is not None:
        sigma[solved.keypoint[of_frame]] = solved.tracks.sigma[of_frame]
    return owner, sigma


def _inside_gate(solved: SolvedTracks, predicted: Prediction, frame: int, sigma: FloatArray) -> BoolArray:
    """Tell which keypoints (P, K) lie where each point is predicted, as far as noise and the point allow."""
    here = solved.keypoints[frame]
    range_m = here.range_m - predicted.range_m[:, None]
    bearing_rad = here.bearing_rad - predicted.bearing_rad[:, None]
    noise = (WIDENED * np.maximum(sigma, solved.typical)) ** 2
    along, across = predicted.covariance[:, :1, 0] + noise[:, 0], predicted.covariance[:, 1:, 1] + noise[:, 1]
    mixed = predicted.covariance[:, :1, 1]
    square = across * range_m**2 - 2 * mixed * range_m * bearing_rad + along * bearing_rad**2
    return np.asarray(square <= solved.config.matching.arc_gate**2 * (along * across - mixed**2))


def _meet(solved: SolvedTracks, track: IntArray, other: IntArray) -> BoolArray:
    """Tell which (M,) pairs of tracks have points that may be one; -1 is nobody's track, and meets none."""
    apart_m = solved.xyz_m[track] - solved.xyz_m[other]
    covariance = solved.covariance_m2[track] + solved.covariance_m2[other]
    square = np.einsum("mi,mi->m", apart_m, np.linalg.solve(covariance, apart_m[..., None])[..., 0])
    return np.asarray((square <= TOGETHER) & solved.known[other] & (other >= 0))


def _measure_likeness(solved: SolvedTracks) -> float:
    """Measure how far apart descriptors of successive observations of a track are: almost all are nearer than this."""
    agrees, track = solved.agrees, solved.tracks.track
    step = np.flatnonzero((np.diff(track) == 0) & agrees[1:] & agrees[:-1]) if len(track) else np.zeros(0, int)
    step = step[:: max(len(step) // PAIRS, 1)]
    if not len(step):
        return 0.0
    before, after = _describe(solved, step), _describe(solved, step + 1)
    apart = [descriptor_distances(a[None], b[None])[0, 0] for a, b in zip(before, after, strict=True)]
    return float(np.percentile(apart, ALIKE))


def _describe(solved: SolvedTracks, observation: IntArray) -> Descriptors:
    """Give the descriptors (M, D) of some observations, at least one."""
    frames, which = solved.tracks.frame[observation].tolist(), solved.keypoint[observation].tolist()
    looks = [solved.keypoints[frame].descriptors[number] for frame, number in zip(frames, which, strict=True)]
    return np.asarray(looks, dtype=looks[0].dtype)


def _gather(solved: SolvedTracks, rows: Sequence[Row]) -> list[Matches]:
    """Sort what was found by pairs of frames, the earlier frame first."""
    if not rows:
        return []
    pairs, cost, sigma = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    turned = pairs[:, 0] > pairs[:, 2]
    pairs[turned] = pairs[turned][:, [2, 3, 0, 1]]
    pairs, first = np.unique(pairs, axis=0, return_index=True)
    cost, sigma = cost[first], sigma[first]
    starts = np.flatnonzero((np.diff(pairs[:, [0, 2]], axis=0, prepend=-1) != 0).any(axis=1))
    stated = solved.tracks.sigma is not None
    return [
        Matches(int(part[0, 0]), int(part[0, 2]), part[:, [1, 3]], costs, sigma=sigmas if stated else None)
        for part, costs, sigmas in zip(*(np.split(value, starts[1:]) for value in (pairs, cost, sigma)), strict=True)
        if len(part)
    ]
