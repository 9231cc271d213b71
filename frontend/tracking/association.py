"""Data association: candidate matches gated by their elevation arcs under the current poses, joined into tracks."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from asfm.config import Config
from asfm.frontend.tracking.track_builder import build_tracks
from asfm.geometry.elevation_arcs import arc_residuals
from asfm.geometry.feature_noise import difference_sigma
from asfm.geometry.poses import invert
from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray, Keypoints, Matches, Tracks


def associate(
    keypoints: Sequence[Keypoints],
    candidates: Sequence[Matches],
    sonar: SonarModel,
    world_from_sonar: FloatArray,
    config: Config,
) -> Tracks:
    """Gate matches by the distance from their elevation arcs under the current poses, and join them into tracks.

    Poses are less certain over larger frame gaps. The gate of each gap is therefore proportional to the median residual
    of its matches, and at least ``tracks.min_gate``. Loops, with gaps above ``matching.max_gap``, share one gate: most
    of their gaps have a single pair, whose gate a wrong loop would set.

    Args:
        keypoints: those of every frame.
        candidates: matches of pairs of frames.
        sonar: gives aperture and noise.
        world_from_sonar: (N, 4, 4) current poses.
        config: sections ``tracks``, ``matching`` and ``noise``.
    """
    matches = [match for match in candidates if len(match)]
    if not matches:
        return build_tracks(keypoints, [], config.tracks.min_views)
    sigma = difference_sigma(sonar, config.noise)
    pixels = [frame.range_bearing for frame in keypoints]
    residual = [_match_residuals(pixels, match, sonar, world_from_sonar, sigma) for match in matches]
    loop_gap = config.matching.max_gap + 1
    gap = np.array([min(match.frame_b - match.frame_a, loop_gap) for match in matches])
    gate = np.empty(len(matches))
    for value in np.unique(gap):
        of_gap = np.flatnonzero(gap == value)
        median = float(np.median(np.concatenate([residual[index] for index in of_gap])))
        gate[of_gap] = max(config.tracks.min_gate, config.tracks.gate_factor * median)
    kept = [
        replace(match, cost=match.cost + 0.1 * distance / limit).reject(distance >= limit, "arc")
        for match, distance, limit in zip(matches, residual, gate, strict=True)
    ]
    return build_tracks(keypoints, kept, config.tracks.min_views)


def _match_residuals(
    pixels: Sequence[FloatArray],
    match: Matches,
    sonar: SonarModel,
    world_from_sonar: FloatArray,
    sigma: FloatArray,
) -> FloatArray:
    """Return the distances (M,) of a pair's matches from their elevation arcs, in sigmas."""
    b_from_a = invert(world_from_sonar[match.frame_b]) @ world_from_sonar[match.frame_a]
    pixel_a, pixel_b = pixels[match.frame_a][match.index[:, 0]], pixels[match.frame_b][match.index[:, 1]]
    return arc_residuals(sonar, np.broadcast_to(b_from_a, (len(match), 4, 4)), pixel_a, pixel_b, sigma)
