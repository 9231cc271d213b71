"""Guided matching: search by projection of triangulated points, to complete tracks and to merge duplicates."""

from collections.abc import Sequence

import numpy as np

from asfm.frontend.matching.nearest import descriptor_distances
from asfm.frontend.tracking.triangulated_tracks import SIGMA_SCALE, Prediction, TriangulatedTracks, predict_observations
from asfm.geometry.poses import angle_difference
from asfm.types import BoolArray, Descriptors, FloatArray, IntArray, Matches

GUIDED_COST_OFFSET = 2.0
"""Added to the cost of guided matches: tracks are built from all other matches first, loops included."""
DESCRIPTOR_PERCENTILE = 90
"""Percentile of the descriptor distances along the tracks that is the largest distance of a guided match."""
SAMPLED_PAIRS = 4000
"""Pairs of successive observations, approximately, whose descriptor distances are sampled for that percentile."""
CHI2_3DOF_99 = 11.3
"""99th percentile of the chi-square distribution with 3 degrees of freedom: gate of two estimates of one point."""


def match_to_landmarks(triangulated: TriangulatedTracks, window: int) -> list[Matches]:
    """Match keypoints with the tracks whose points are predicted near them.

    Each point with an inlier observation inside the window is projected into the frames that lack it. A keypoint inside
    the gate of noise and point covariance, with a descriptor distance typical of tracks, is matched with the track's
    nearest observation in time if both are mutual nearest neighbours. This completes the track if the keypoint has
    none, and merges two tracks if it has one and both points agree. The association decides which matches are used:
    guided ones rank after all others.

    Args:
        triangulated: tracks, points and poses of the previous round.
        window: largest distance in frames of an inlier observation; 0 gives no matches.

    Returns:
        Matches of pairs of frames, the earlier frame first; none without inlier observations.
    """
    limit = _typical_descriptor_distance(triangulated) if window else 0.0
    if limit <= 0:
        return []
    frames = range(len(triangulated.keypoints))
    parts = [_match_frame(triangulated, frame, window, limit) for frame in frames]
    return _group_by_pair(triangulated, [part for part in parts if part is not None])


def add_matches(known: Sequence[Matches], found: Sequence[Matches]) -> list[Matches]:
    """Add the found matches to the known ones, leaving out pairs of keypoints that are known."""
    existing = {_pair_key(match, pair) for match in known for pair in match.index.tolist()}
    added = list(known)
    for match in found:
        duplicate = np.array([_pair_key(match, pair) in existing for pair in match.index.tolist()], dtype=bool)
        if not duplicate.all():
            kept = ~duplicate
            sigma = None if match.sigma is None else match.sigma[kept]
            added.append(Matches(match.frame_a, match.frame_b, match.index[kept], match.cost[kept], sigma=sigma))
    return added


def _pair_key(match: Matches, pair: Sequence[int]) -> tuple[int, int, int, int]:
    return match.frame_a, match.frame_b, pair[0], pair[1]


FrameMatches = tuple[IntArray, FloatArray, FloatArray]
"""(M, 4) frame of an observation, its keypoint, frame to match, its keypoint; (M,) costs; (M, 2) sigmas."""


def _match_frame(triangulated: TriangulatedTracks, frame: int, window: int, limit: float) -> FrameMatches | None:
    """Match the keypoints of one frame with the points predicted there; None without any of either."""
    predicted, here = predict_observations(triangulated, frame, window), triangulated.keypoints[frame]
    if not len(predicted.track) or not len(here):
        return None
    track_of, sigma = _keypoint_tracks(triangulated, frame)
    distance = descriptor_distances(_descriptors_of(triangulated, predicted.nearest), here.descriptors)
    distance[(distance > limit) | ~_inside_gate(triangulated, predicted, frame, sigma)] = np.inf
    best = distance.argmin(axis=1)
    rows = np.arange(len(best))
    matched = np.isfinite(distance[rows, best]) & (distance.argmin(axis=0)[best] == rows)
    other = track_of[best]
    matched[matched] &= (other[matched] < 0) | _same_point(triangulated, predicted.track[matched], other[matched])
    nearest, best = predicted.nearest[matched], best[matched]
    pairs = np.stack(
        [triangulated.tracks.frame[nearest], triangulated.keypoint[nearest], np.full(len(best), frame), best], axis=1
    )
    return pairs, GUIDED_COST_OFFSET + distance[rows[matched], best].astype(float) / limit, sigma[best]


def _keypoint_tracks(triangulated: TriangulatedTracks, frame: int) -> tuple[IntArray, FloatArray]:
    """Return the track (K,) of each keypoint of a frame, -1 where it has none, and its standard deviations (K, 2)."""
    count, of_frame = len(triangulated.keypoints[frame]), triangulated.by_frame[frame]
    track_of, sigma = np.full(count, -1), np.tile(triangulated.default_sigma, (count, 1))
    track_of[triangulated.keypoint[of_frame]] = triangulated.tracks.track[of_frame]
    if triangulated.tracks.sigma is not None:
        sigma[triangulated.keypoint[of_frame]] = triangulated.tracks.sigma[of_frame]
    return track_of, sigma


def _inside_gate(triangulated: TriangulatedTracks, predicted: Prediction, frame: int, sigma: FloatArray) -> BoolArray:
    """Return which keypoints (P, K) lie inside the gate of each predicted point: noise plus point covariance."""
    here = triangulated.keypoints[frame]
    range_m = here.range_m - predicted.range_m[:, None]
    bearing_rad = angle_difference(here.bearing_rad, predicted.bearing_rad[:, None])
    noise = (SIGMA_SCALE * np.maximum(sigma, triangulated.default_sigma)) ** 2
    range_m2, bearing_rad2 = predicted.covariance[:, :1, 0] + noise[:, 0], predicted.covariance[:, 1:, 1] + noise[:, 1]
    mixed = predicted.covariance[:, :1, 1]
    scaled = bearing_rad2 * range_m**2 - 2 * mixed * range_m * bearing_rad + range_m2 * bearing_rad**2
    return np.asarray(scaled <= triangulated.config.matching.arc_gate**2 * (range_m2 * bearing_rad2 - mixed**2))


def _same_point(triangulated: TriangulatedTracks, track: IntArray, other: IntArray) -> BoolArray:
    """Return which (M,) pairs of tracks have points that agree within their covariances; false where other is -1."""
    difference_m = triangulated.xyz_m[track] - triangulated.xyz_m[other]
    covariance = triangulated.covariance_m2[track] + triangulated.covariance_m2[other]
    squared_distance = np.einsum("mi,mi->m", difference_m, np.linalg.solve(covariance, difference_m[..., None])[..., 0])
    return np.asarray((squared_distance <= CHI2_3DOF_99) & triangulated.has_point[other] & (other >= 0))


def _typical_descriptor_distance(triangulated: TriangulatedTracks) -> float:
    """Return a high percentile of the descriptor distances between successive inliers of tracks; 0 without any."""
    inlier, track = triangulated.inlier, triangulated.tracks.track
    step = np.flatnonzero((np.diff(track) == 0) & inlier[1:] & inlier[:-1]) if len(track) else np.zeros(0, int)
    step = step[:: max(len(step) // SAMPLED_PAIRS, 1)]
    if not len(step):
        return 0.0
    first, second = _descriptors_of(triangulated, step), _descriptors_of(triangulated, step + 1)
    distances = [descriptor_distances(a[None], b[None])[0, 0] for a, b in zip(first, second, strict=True)]
    return float(np.percentile(distances, DESCRIPTOR_PERCENTILE))


def _descriptors_of(triangulated: TriangulatedTracks, observation: IntArray) -> Descriptors:
    """Return the descriptors (M, D) of one or more observations."""
    frames, which = triangulated.tracks.frame[observation].tolist(), triangulated.keypoint[observation].tolist()
    found = [triangulated.keypoints[frame].descriptors[number] for frame, number in zip(frames, which, strict=True)]
    return np.asarray(found, dtype=found[0].dtype)


def _group_by_pair(triangulated: TriangulatedTracks, parts: Sequence[FrameMatches]) -> list[Matches]:
    """Group the matches of all frames by pair of frames, the earlier frame first, each match once."""
    if not parts:
        return []
    pairs, cost, sigma = (np.concatenate(values) for values in zip(*parts, strict=True))
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
