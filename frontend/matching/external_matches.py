"""Filtering of external matches: keypoints and matches computed elsewhere, checked by the same outlier filters."""

from collections.abc import Sequence

import numpy as np

from asfm.config import Config
from asfm.frontend.matching.filter_chain import filter_pairs
from asfm.frontend.matching.frame_pair import FramePair, predict_arcs
from asfm.frontend.matching.nearest import NearestNeighbours
from asfm.geometry.sonar import SonarModel
from asfm.navigation.pose_prediction import PosePrediction
from asfm.types import ExternalMatches, Keypoints, Matches

DESCRIPTOR_FILTERS = ("mutual", "ratio")
"""Filters on descriptor distances, which an external matcher has applied or chosen not to."""


def filter_external_matches(
    external: ExternalMatches,
    frame: int,
    keypoints: Sequence[Keypoints],
    config: Config,
    sonar: SonarModel,
    prediction: PosePrediction | None = None,
) -> list[Matches]:
    """Filter the external matches of a frame with the frames before it, smallest gap first.

    The filters of ``matching.filters`` apply, except those on descriptor distances (mutual, ratio). The matcher's own
    cost takes the place of the ratio.

    Args:
        external: keypoints and matches of the whole sequence.
        frame: the later frame of each pair.
        keypoints: those of frames 0..frame, with their patches.
        config: section ``matching`` and the filters' own.
        sonar: the pixel grid.
        prediction: poses before the images are read; without it the arc filter passes every match.
    """
    matches = external.with_previous(frame)
    pairs = [_make_pair(match, keypoints, sonar, prediction, config) for match in matches]
    filters = [name for name in config.matching.filters if name not in DESCRIPTOR_FILTERS]
    return filter_pairs(pairs, [(match.frame_a, match.frame_b) for match in matches], filters, config)


def _make_pair(
    match: Matches,
    keypoints: Sequence[Keypoints],
    sonar: SonarModel,
    prediction: PosePrediction | None,
    config: Config,
) -> FramePair:
    a, b = keypoints[match.frame_a], keypoints[match.frame_b]
    nearest = NearestNeighbours(match.index, match.cost, np.ones(len(match), dtype=bool))
    if prediction is None:
        return FramePair(a, b, nearest, sonar)
    arcs, sigma = predict_arcs((match.frame_a, match.frame_b), a, sonar, prediction, config.noise)
    return FramePair(a, b, nearest, sonar, arcs, sigma)
