"""Association: which candidate matches the current poses allow, joined into tracks."""

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
    """Keep the matches that lie near their elevation arcs under the current poses and join them into tracks.

    Poses are less certain over larger gaps. The gate of each gap therefore follows the typical residual of its
    matches, most of which are right, and never falls below ``tracks.min_gate``. Loops, gaps wider than
    ``matching.max_gap``, share one gate: a gap of its own may have a single pair, and a wrong one would set its gate.

    Args:
        keypoints: those of every frame.
        candidates: matches of pairs of frames.
        world_from_sonar: (N, 4, 4) current poses.
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
        typical = float(np.median(np.concatenate([residual[index] for index in of_gap])))
        gate[of_gap] = max(config.tracks.min_gate, config.tracks.gate_factor * typical)
    kept = [
        replace(match, cost=match.cost + 0.1 * near / limit).reject(near >= limit, "arc")
        for match, near, limit in zip(matches, residual, gate, strict=True)
    ]
    return build_tracks(keypoints, kept, config.tracks.min_views)


def _match_residuals(
    pixels: Sequence[FloatArray],
    match: Matches,
    sonar: SonarModel,
    world_from_sonar: FloatArray,
    sigma: FloatArray,
) -> FloatArray:
    """Distance (M,) of every match of a pair from its elevation arc, in sigmas; pixels are (K, 2) a frame."""
    b_from_a = invert(world_from_sonar[match.frame_b]) @ world_from_sonar[match.frame_a]
    pixel_a, pixel_b = pixels[match.frame_a][match.index[:, 0]], pixels[match.frame_b][match.index[:, 1]]
    return arc_residuals(sonar, np.broadcast_to(b_from_a, (len(match), 4, 4)), pixel_a, pixel_b, sigma)
