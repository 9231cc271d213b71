"""Plain reference of guided matching: one keypoint and one point at a time."""

import numpy as np

from asfm.frontend.tracking.guided_matching import (
    CHI2_3DOF_99,
    DESCRIPTOR_PERCENTILE,
    GUIDED_COST_OFFSET,
)
from asfm.frontend.tracking.triangulated_tracks import SIGMA_SCALE, Prediction, TriangulatedTracks, predict_observations
from asfm.types import FloatArray

Key = tuple[int, int, int, int]
"""Earlier frame, its keypoint, later frame, its keypoint."""


def match_plainly(triangulated: TriangulatedTracks, window: int) -> dict[Key, float]:
    """Return the cost of each guided match."""
    tracks, limit, found = triangulated.tracks, _limit(triangulated), dict[Key, float]()
    for frame in range(len(triangulated.keypoints)):
        predicted = predict_observations(triangulated, frame, window)
        row_of = {int(triangulated.keypoint[row]): int(row) for row in np.flatnonzero(tracks.frame == frame)}
        distance = _gated_distances(triangulated, predicted, frame, row_of)
        distance[distance > limit] = np.inf
        for point, row in enumerate(distance):
            keypoint = int(np.argmin(row))
            if not np.isfinite(row[keypoint]) or np.argmin(distance[:, keypoint]) != point:
                continue
            if keypoint in row_of and not _agree(triangulated, predicted.track[point], tracks.track[row_of[keypoint]]):
                continue
            nearest = predicted.nearest[point]
            ends = sorted([(int(tracks.frame[nearest]), int(triangulated.keypoint[nearest])), (frame, keypoint)])
            found.setdefault((*ends[0], *ends[1]), GUIDED_COST_OFFSET + float(row[keypoint]) / limit)
    return found


def _gated_distances(
    triangulated: TriangulatedTracks, predicted: Prediction, frame: int, row_of: dict[int, int]
) -> FloatArray:
    """Return the Hamming distances (P, K) of keypoints inside the gate of each point; infinite outside."""
    here, stated = triangulated.keypoints[frame], triangulated.tracks.sigma
    distance = np.full((len(predicted.track), len(here)), np.inf)
    for point, nearest in enumerate(predicted.nearest.tolist()):
        for keypoint in range(len(here)):
            sigma = triangulated.default_sigma
            if stated is not None and keypoint in row_of:
                sigma = np.maximum(sigma, stated[row_of[keypoint]])
            offset = here.range_bearing[keypoint] - [predicted.range_m[point], predicted.bearing_rad[point]]
            covariance = predicted.covariance[point] + np.diag((SIGMA_SCALE * sigma) ** 2)
            if offset @ np.linalg.solve(covariance, offset) <= triangulated.config.matching.arc_gate**2:
                distance[point, keypoint] = _hamming(_descriptor(triangulated, nearest), here.descriptors[keypoint])
    return distance


def _agree(triangulated: TriangulatedTracks, one: int, other: int) -> bool:
    """Return whether the points of two tracks are one point."""
    offset_m = triangulated.xyz_m[one] - triangulated.xyz_m[other]
    covariance = triangulated.covariance_m2[one] + triangulated.covariance_m2[other]
    near = offset_m @ np.linalg.solve(covariance, offset_m) <= CHI2_3DOF_99
    return bool(near and triangulated.has_point[other])


def _limit(triangulated: TriangulatedTracks) -> float:
    """Return the largest descriptor distance of a guided match."""
    track, inlier = triangulated.tracks.track, triangulated.inlier
    distances = [
        _hamming(_descriptor(triangulated, row), _descriptor(triangulated, row + 1))
        for row in range(len(track) - 1)
        if track[row] == track[row + 1] and inlier[row] and inlier[row + 1]
    ]
    return float(np.percentile(distances, DESCRIPTOR_PERCENTILE))


def _descriptor(triangulated: TriangulatedTracks, row: int) -> FloatArray:
    frame, keypoint = int(triangulated.tracks.frame[row]), int(triangulated.keypoint[row])
    return np.asarray(triangulated.keypoints[frame].descriptors[keypoint])


def _hamming(first: FloatArray, second: FloatArray) -> float:
    return float(np.unpackbits(np.bitwise_xor(first, second)).sum())
