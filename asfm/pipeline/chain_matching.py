"""Feature matching by several filter chains at once: features, candidates and their losses are computed once."""

from collections.abc import Sequence as Items
from dataclasses import dataclass

from asfm.config import Config, Filter
from asfm.frontend.denoising.echo_mask import detect_echo_mask
from asfm.frontend.features.keypoints import detect_keypoints
from asfm.frontend.matching.candidate_memo import CandidateMemo
from asfm.frontend.matching.pair_matching import match_with_previous
from asfm.frontend.matching.shared_alignment import align_chains
from asfm.navigation.pose_prediction import PosePrediction
from asfm.prefetch import prefetch_map
from asfm.sequence import Sequence
from asfm.types import Frame, Keypoints, Matches


@dataclass(frozen=True, eq=False)
class FilterChain:
    """One way of filtering the matches of a sequence."""

    filters: tuple[Filter, ...]
    """Outlier filters in their order."""
    prediction: PosePrediction | None = None
    """Poses before the images are read, for the arc filter; None without odometry."""


def extract_chains(
    sequence: Sequence, config: Config, chains: Items[FilterChain]
) -> tuple[list[Keypoints], list[list[Matches]]]:
    """Detect the keypoints of every frame once, and match the frames by each filter chain.

    Each chain's matches are those of :func:`asfm.pipeline.feature_matching.extract_matches` with its filters.

    Args:
        sequence: frames and sonar.
        config: sections of the front-end; ``matching.filters`` is replaced by each chain's.
        chains: filters and predicted poses.

    Returns:
        The keypoints of every frame without patches, and for each chain the matches of every pair of frames.

    Raises:
        AsfmError: a frame cannot be read.
    """
    settings = [
        config.model_copy(update={"matching": config.matching.model_copy(update={"filters": chain.filters})})
        for chain in chains
    ]

    def detect(frame: Frame) -> tuple[int, Keypoints]:
        return frame.index, detect_keypoints(frame, detect_echo_mask(frame, config), sequence.sonar, config)

    keypoints: list[Keypoints] = []
    found: list[list[Matches]] = [[] for _ in chains]
    for frame, detected in prefetch_map(detect, sequence):
        keypoints.append(detected)
        memo = CandidateMemo()
        filtered = [
            match_with_previous(frame, keypoints, own, sequence.sonar, chain.prediction, memo)
            for own, chain in zip(settings, chains, strict=True)
        ]
        for matches, aligned in zip(found, align_chains(filtered, keypoints, sequence.sonar, config), strict=True):
            matches += aligned
        if frame >= config.matching.max_gap:
            keypoints[frame - config.matching.max_gap] = keypoints[frame - config.matching.max_gap].without_patches()
    return [frame.without_patches() for frame in keypoints], found
