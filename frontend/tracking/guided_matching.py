"""Re-matching guided by points and poses: tracks are completed where they should be seen, merged where they meet."""

from collections.abc import Sequence

import numpy as np

from asfm.frontend.matching.nearest import descriptor_distances
from asfm.frontend.tracking.triangulated_tracks import WIDENED, Prediction, TriangulatedTracks, predict_observations
from asfm.types import BoolArray, Descriptors, FloatArray, IntArray, Matches

GUIDED_COST_OFFSET = 2.0
"""Added to the cost of these matches: tracks are built from what frames say of each other first, loops included."""
DESCRIPTOR_PERCENTILE = 90
"""Percentile of the descriptors' distances along the tracks above which two are not alike."""
PAIRS = 4000
"""Steps of tracks of which that percentile is taken."""
CHI2_3DOF_99 = 11.3
"""Squared distance of two points, whitened by both covariances, that one point has in 99 of 100 cases (chi-square, 3
degrees of freedom)."""


def match_to_landmarks(triangulated: TriangulatedTracks, window: int) -> list[Matches]:
    """Match keypoints with tracks that should be seen where they are.

    Each point with agreeing observations at most a window away is predicted into the frames that lack it. A keypoint
    inside the gate of noise and of the point's own covariance, whose descriptor is as alike as those along the tracks
    are, is matched with the track's nearest observation, where both prefer each other. If no track has the keypoint,
    this completes the track; if another has, it merges the two, provided that their points agree. Whether matches
    enter a track is up to the association: they come after all others, and never put two observations in one frame.

    Args:
        triangulated: a round's result.
        window: how many frames away an agreeing observation may be; 0 proposes nothing.

    Returns:
        Matches of pairs of frames; without any agreeing observations none.
    """
    limit = _measure_likeness(triangulated) if window else 0.0
    if limit <= 0:
        return []
    rows = [_rematch_frame(triangulated, frame, window, limit) for frame in range(len(triangulated.keypoints))]
    return _gather(triangulated, [row for row in rows if row is not None])


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


def _rematch_frame(triangulated: TriangulatedTracks, frame: int, window: int, limit: float) -> Row | None:
    """Match the keypoints of one frame."""
    predicted, here = predict_observations(triangulated, frame, window), triangulated.keypoints[frame]
    if not len(predicted.track) or not len(here):
        return None
    owner, sigma = _look_up(triangulated, frame)
    distance = descriptor_distances(_describe(triangulated, predicted.nearest), here.descriptors)
    distance[(distance > limit) | ~_inside_gate(triangulated, predicted, frame, sigma)] = np.inf
    best = distance.argmin(axis=1)
    rows = np.arange(len(best))
    good = np.isfinite(distance[rows, best]) & (distance.argmin(axis=0)[best] == rows)
    other = owner[best]
    good[good] &= (other[good] < 0) | _meet(triangulated, predicted.track[good], other[good])
    nearest, best = predicted.nearest[good], best[good]
    pairs = np.stack(
        [triangulated.tracks.frame[nearest], triangulated.keypoint[nearest], np.full(len(best), frame), best], axis=1
    )
    return pairs, GUIDED_COST_OFFSET + distance[rows[good], best].astype(float) / limit, sigma[best]


def _look_up(triangulated: TriangulatedTracks, frame: int) -> tuple[IntArray, FloatArray]:
    """Give the track (K,) of each keypoint of a frame, -1 where it has none, and its (K, 2) sigma."""
    count, of_frame = len(triangulated.keypoints[frame]), triangulated.by_frame[frame]
    owner, sigma = np.full(count, -1), np.tile(triangulated.default_sigma, (count, 1))
    owner[triangulated.keypoint[of_frame]] = triangulated.tracks.track[of_frame]
    if triangulated.tracks.sigma is not None:
        sigma[triangulated.keypoint[of_frame]] = triangulated.tracks.sigma[of_frame]
    return owner, sigma


def _inside_gate(triangulated: TriangulatedTracks, predicted: Prediction, frame: int, sigma: FloatArray) -> BoolArray:
    """Tell which keypoints (P, K) lie where each point is predicted, as far as noise and the point allow."""
    here = triangulated.keypoints[frame]
    range_m = here.range_m - predicted.range_m[:, None]
    bearing_rad = here.bearing_rad - predicted.bearing_rad[:, None]
    noise = (WIDENED * np.maximum(sigma, triangulated.default_sigma)) ** 2
    along, across = predicted.covariance[:, :1, 0] + noise[:, 0], predicted.covariance[:, 1:, 1] + noise[:, 1]
    mixed = predicted.covariance[:, :1, 1]
    square = across * range_m**2 - 2 * mixed * range_m * bearing_rad + along * bearing_rad**2
    return np.asarray(square <= triangulated.config.matching.arc_gate**2 * (along * across - mixed**2))


def _meet(triangulated: TriangulatedTracks, track: IntArray, other: IntArray) -> BoolArray:
    """Tell which (M,) pairs of tracks have points that may be one; -1 is nobody's track, and meets none."""
    apart_m = triangulated.xyz_m[track] - triangulated.xyz_m[other]
    covariance = triangulated.covariance_m2[track] + triangulated.covariance_m2[other]
    square = np.einsum("mi,mi->m", apart_m, np.linalg.solve(covariance, apart_m[..., None])[..., 0])
    return np.asarray((square <= CHI2_3DOF_99) & triangulated.has_point[other] & (other >= 0))


def _measure_likeness(triangulated: TriangulatedTracks) -> float:
    """Measure how far apart descriptors of successive observations of a track are: almost all are nearer than this."""
    inlier, track = triangulated.inlier, triangulated.tracks.track
    step = np.flatnonzero((np.diff(track) == 0) & inlier[1:] & inlier[:-1]) if len(track) else np.zeros(0, int)
    step = step[:: max(len(step) // PAIRS, 1)]
    if not len(step):
        return 0.0
    before, after = _describe(triangulated, step), _describe(triangulated, step + 1)
    apart = [descriptor_distances(a[None], b[None])[0, 0] for a, b in zip(before, after, strict=True)]
    return float(np.percentile(apart, DESCRIPTOR_PERCENTILE))


def _describe(triangulated: TriangulatedTracks, observation: IntArray) -> Descriptors:
    """Give the descriptors (M, D) of some observations, at least one."""
    frames, which = triangulated.tracks.frame[observation].tolist(), triangulated.keypoint[observation].tolist()
    looks = [triangulated.keypoints[frame].descriptors[number] for frame, number in zip(frames, which, strict=True)]
    return np.asarray(looks, dtype=looks[0].dtype)


def _gather(triangulated: TriangulatedTracks, rows: Sequence[Row]) -> list[Matches]:
    """Sort what was found by pairs of frames, the earlier frame first."""
    if not rows:
        return []
    pairs, cost, sigma = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    turned = pairs[:, 0] > pairs[:, 2]
    pairs[turned] = pairs[turned][:, [2, 3, 0, 1]]
    pairs, first = np.unique(pairs, axis=0, return_index=True)
    cost, sigma = cost[first], sigma[first]
    starts = np.flatnonzero((np.diff(pairs[:, [0, 2]], axis=0, prepend=-1) != 0).any(axis=1))
    stated = triangulated.tracks.sigma is not None
    return [
        Matches(int(part[0, 0]), int(part[0, 2]), part[:, [1, 3]], costs, sigma=sigmas if stated else None)
        for part, costs, sigmas in zip(*(np.split(value, starts[1:]) for value in (pairs, cost, sigma)), strict=True)
        if len(part)
    ]
