"""Keypoints and matches computed elsewhere, judged by the same filters as asfm's own."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from asfm.config import Config
from asfm.frontend.matching.filters import FramePair, difference_sigma, filter_matches
from asfm.frontend.matching.nearest import NearestNeighbours
from asfm.geometry.elevation_arcs import PosePrediction, project_arcs
from asfm.geometry.sonar import SonarModel
from asfm.types import Keypoints, Matches

OF_DESCRIPTORS = ("mutual", "ratio")
"""Filters that look at descriptors' distances: whoever matched has had that in hand."""


@dataclass(frozen=True)
class ExternalMatches:
    """What somebody else's detector and matcher found in a whole sequence."""

    keypoints: tuple[Keypoints, ...]
    """One a frame, without patches."""
    matches: tuple[Matches, ...]
    """frame_a comes before frame_b; no two of one pair of frames."""

    @property
    def longest_gap(self) -> int:
        """Largest number of frames between two that are matched; 0 without matches."""
        return max((match.frame_b - match.frame_a for match in self.matches), default=0)

    def with_previous(self, frame: int) -> list[Matches]:
        """Give the matches of a frame with those before it, nearest first."""
        return sorted((match for match in self.matches if match.frame_b == frame), key=lambda match: -match.frame_a)


def filter_external_matches(
    correspondences: ExternalMatches,
    frame: int,
    keypoints: Sequence[Keypoints],
    config: Config,
    sonar: SonarModel,
    predicted: PosePrediction | None = None,
) -> list[Matches]:
    """Let the filters of ``matching.filters`` judge the matches of a frame with those before it, nearest first.

    The filters that look at descriptors, mutual and ratio, are left out. A match's own cost takes the place of its
    ratio.

    Args:
        frame: the later frame of each pair.
        keypoints: those of frames 0..frame, with their patches.
        sonar: the pixel grid.
        predicted: the arc filter passes everything without.
    """
    filters = tuple(name for name in config.matching.filters if name not in OF_DESCRIPTORS)
    config = config.model_copy(update={"matching": config.matching.model_copy(update={"filters": filters})})
    judged = []
    for match in correspondences.with_previous(frame):
        a, b = keypoints[match.frame_a], keypoints[match.frame_b]
        nearest = NearestNeighbours(match.index, match.cost, np.ones(len(match), dtype=bool))
        pair = FramePair(a, b, nearest, sonar)
        if predicted is not None:
            sigma = predicted.predicted_sigma(
                match.frame_a, match.frame_b, a.range_m, difference_sigma(sonar, config.noise)
            )
            pixel_a = np.stack([a.range_m, a.bearing_rad], axis=1)
            arcs = project_arcs(sonar, predicted.relative_pose(match.frame_a, match.frame_b), pixel_a)
            pair = FramePair(a, b, nearest, sonar, arcs, sigma)
        judged.append(filter_matches(pair, match.frame_a, match.frame_b, config))
    return judged
