"""Candidate matches: every frame with those before it, or pairs that somebody names, cleaned by the filters."""

from collections.abc import Iterable, Sequence

import numpy as np

from asfm.config import Config
from asfm.frontend.matching.filters import FramePair, difference_sigma, filter_pairs
from asfm.frontend.matching.nearest import find_nearest_neighbours
from asfm.geometry.elevation_arcs import PosePrediction, arc_box_candidates, project_arcs
from asfm.geometry.sonar import SonarModel
from asfm.types import Keypoints, Matches

DOUBTFUL = 0.15
"""Where a prediction leaves fewer of the keypoints matched than this share, it may be the prediction that is wrong."""
CHANCE = 8
"""More matches than the prediction leaves, twice as many and these, are no chance: the prediction is not believed."""


def match_frames(
    frame_a: int,
    frame_b: int,
    keypoints: Sequence[Keypoints],
    config: Config,
    sonar: SonarModel | None = None,
    predicted: PosePrediction | None = None,
) -> Matches:
    """Match two frames: nearest descriptors, then the filters of ``matching.filters``.

    Args:
        frame_a, frame_b: indices into keypoints and predicted poses.
        sonar: gives filters the noise and the aperture; without it there is no guidance and no clique.
        predicted: guide the matching and its arc filter; neither is without. A prediction that the images
            contradict, because without it far more matches agree with each other, is not used.
    """
    return match_pairs([(frame_a, frame_b)], keypoints, config, sonar, predicted)[0]


def match_with_previous(
    frame: int,
    keypoints: Sequence[Keypoints],
    config: Config,
    sonar: SonarModel | None = None,
    predicted: PosePrediction | None = None,
) -> list[Matches]:
    """Match a frame with each of the frames 1..max_gap before it, nearest first. See :func:`match_frames`."""
    earliest = max(0, frame - config.matching.max_gap)
    pairs = [(other, frame) for other in range(frame - 1, earliest - 1, -1)]
    return match_pairs(pairs, keypoints, config, sonar, predicted)


def match_pairs(
    pairs: Iterable[tuple[int, int]],
    keypoints: Sequence[Keypoints],
    config: Config,
    sonar: SonarModel | None = None,
    predicted: PosePrediction | None = None,
) -> list[Matches]:
    """Match the pairs of frames (a, b) that somebody names, such as loops. See :func:`match_frames`."""
    named = list(pairs)
    if sonar is None or predicted is None:
        return _match_freely(named, keypoints, config, sonar)
    proposed = [_propose_near(a, b, keypoints[a], keypoints[b], config, sonar, predicted) for a, b in named]
    matches = filter_pairs(proposed, named, config)
    few = [number for number, (a, b) in enumerate(named) if _is_doubtful(matches[number], keypoints[a], keypoints[b])]
    for number, free in zip(
        few, _match_freely([named[number] for number in few], keypoints, config, sonar), strict=True
    ):
        if len(free) > 2 * len(matches[number]) + CHANCE:
            matches[number] = free
    return matches


def _is_doubtful(matches: Matches, a: Keypoints, b: Keypoints) -> bool:
    return len(matches) < DOUBTFUL * min(len(a), len(b))


def _match_freely(
    pairs: Sequence[tuple[int, int]], keypoints: Sequence[Keypoints], config: Config, sonar: SonarModel | None
) -> list[Matches]:
    """Match without a prediction."""
    sides = [(keypoints[a], keypoints[b]) for a, b in pairs]
    return (
        filter_pairs([FramePair(a, b, find_nearest_neighbours(a, b), sonar) for a, b in sides], pairs, config)
        if sides
        else []
    )


def _propose_near(
    frame_a: int,
    frame_b: int,
    a: Keypoints,
    b: Keypoints,
    config: Config,
    sonar: SonarModel,
    predicted: PosePrediction,
) -> FramePair:
    """Find the nearest descriptors among keypoints near the predicted elevation arc."""
    sigma = predicted.predicted_sigma(frame_a, frame_b, a.range_m, difference_sigma(sonar, config.noise))
    pixel_a, pixel_b = (np.stack([frame.range_m, frame.bearing_rad], axis=1) for frame in (a, b))
    arcs = project_arcs(sonar, predicted.relative_pose(frame_a, frame_b), pixel_a)
    near = arc_box_candidates(arcs, pixel_b, config.matching.arc_gate * sigma) if config.matching.guided else None
    return FramePair(a, b, find_nearest_neighbours(a, b, near), sonar, arcs, sigma)
