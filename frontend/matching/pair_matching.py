"""Pair matching: nearest-neighbour matches of frame pairs, filtered by the filter chain, guided by predicted poses."""

from collections.abc import Iterable, Sequence

from asfm.config import Config
from asfm.frontend.matching.candidate_memo import CandidateMemo
from asfm.frontend.matching.filter_chain import filter_pairs
from asfm.frontend.matching.frame_pair import FramePair, predict_arcs
from asfm.frontend.matching.nearest import NearestNeighbours, find_nearest_neighbours
from asfm.geometry.elevation_arcs import arc_box_candidates
from asfm.geometry.sonar import SonarModel
from asfm.navigation.pose_prediction import PosePrediction
from asfm.types import Keypoints, Matches

MIN_MATCHED_SHARE = 0.15
"""Smallest share of keypoints matched under a prediction; below it the prediction itself may be wrong."""
MIN_GAIN = 8
"""Without the prediction, at least twice as many matches and these more must agree for it to be rejected."""


def match_with_previous(
    frame: int,
    keypoints: Sequence[Keypoints],
    config: Config,
    sonar: SonarModel,
    prediction: PosePrediction | None = None,
    memo: CandidateMemo | None = None,
) -> list[Matches]:
    """Match a frame with each of the frames 1..max_gap before it, smallest gap first. See :func:`match_pairs`."""
    earliest = max(0, frame - config.matching.max_gap)
    pairs = [(other, frame) for other in range(frame - 1, earliest - 1, -1)]
    return match_pairs(pairs, keypoints, config, sonar, prediction, memo)


def match_pairs(
    frames: Iterable[tuple[int, int]],
    keypoints: Sequence[Keypoints],
    config: Config,
    sonar: SonarModel,
    prediction: PosePrediction | None = None,
    memo: CandidateMemo | None = None,
) -> list[Matches]:
    """Match pairs of frames: nearest neighbours in descriptor space, then the filters of ``matching.filters``.

    Args:
        frames: indices (a, b) of the frames of each pair.
        keypoints: those of every frame, with their patches.
        config: section ``matching`` and the filters' own.
        sonar: gives the filters noise and aperture.
        prediction: guides the arc filter, and the matching where ``matching.guided`` is set. It is ignored for pairs
            where far more matches agree with each other without it.
        memo: candidates of the same keypoints that other filters were applied to; what is found is added.
    """
    pairs, memo = list(frames), memo or CandidateMemo()
    if prediction is None:
        return _match_unguided(pairs, keypoints, config, sonar, memo)
    if config.matching.guided:
        proposed = [_propose_near_arcs(pair, keypoints, config, sonar, prediction) for pair in pairs]
    else:
        proposed = [_propose(pair, keypoints, config, sonar, prediction, memo) for pair in pairs]
    matches = filter_pairs(proposed, pairs, config.matching.filters, config)
    sparse = [number for number, (a, b) in enumerate(pairs) if _is_sparse(matches[number], keypoints[a], keypoints[b])]
    unguided = _match_unguided([pairs[number] for number in sparse], keypoints, config, sonar, memo)
    for number, found in zip(sparse, unguided, strict=True):
        if len(found) > 2 * len(matches[number]) + MIN_GAIN:
            matches[number] = found
    return matches


def _is_sparse(matches: Matches, a: Keypoints, b: Keypoints) -> bool:
    return len(matches) < MIN_MATCHED_SHARE * min(len(a), len(b))


def _match_unguided(
    frames: Sequence[tuple[int, int]],
    keypoints: Sequence[Keypoints],
    config: Config,
    sonar: SonarModel,
    memo: CandidateMemo,
) -> list[Matches]:
    """Match without a prediction of the poses."""
    pairs = [
        FramePair(
            keypoints[a],
            keypoints[b],
            _find_nearest((a, b), keypoints, memo),
            sonar,
            ssl_loss=memo.ssl_loss((a, b), len(keypoints[a])),
        )
        for a, b in frames
    ]
    return filter_pairs(pairs, frames, config.matching.filters, config)


def _find_nearest(frames: tuple[int, int], keypoints: Sequence[Keypoints], memo: CandidateMemo) -> NearestNeighbours:
    if frames not in memo.nearest:
        memo.nearest[frames] = find_nearest_neighbours(keypoints[frames[0]], keypoints[frames[1]])
    return memo.nearest[frames]


def _propose(
    frames: tuple[int, int],
    keypoints: Sequence[Keypoints],
    config: Config,
    sonar: SonarModel,
    prediction: PosePrediction,
    memo: CandidateMemo,
) -> FramePair:
    """Find nearest neighbours among all keypoints, and predict their elevation arcs."""
    a, b = keypoints[frames[0]], keypoints[frames[1]]
    arcs, sigma = predict_arcs(frames, a, sonar, prediction, config.noise)
    loss = memo.ssl_loss(frames, len(a))
    return FramePair(a, b, _find_nearest(frames, keypoints, memo), sonar, arcs, sigma, loss)


def _propose_near_arcs(
    frames: tuple[int, int],
    keypoints: Sequence[Keypoints],
    config: Config,
    sonar: SonarModel,
    prediction: PosePrediction,
) -> FramePair:
    """Find nearest neighbours among the keypoints near the predicted elevation arcs."""
    a, b = keypoints[frames[0]], keypoints[frames[1]]
    arcs, sigma = predict_arcs(frames, a, sonar, prediction, config.noise)
    near = arc_box_candidates(arcs, b.range_bearing, config.matching.arc_gate * sigma)
    return FramePair(a, b, find_nearest_neighbours(a, b, near), sonar, arcs, sigma)
