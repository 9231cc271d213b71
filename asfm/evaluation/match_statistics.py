"""Statistics of matches over frame pairs: precision, recall, arc inlier ratio and localisation error."""

from collections import abc
from dataclasses import dataclass

import numpy as np

from asfm.evaluation.association import within_reach
from asfm.evaluation.matching import MatchQuality, evaluate_pair_by_arcs, evaluate_pairs_by_truth, pool_pairs
from asfm.evaluation.trajectory import interpolate_groundtruth
from asfm.evaluation.view_change import ViewChange, measure_view_change
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, FrameTruth, Keypoints, Matches


@dataclass(frozen=True)
class PairStatistics:
    """The matches of one frame pair whose true poses are known."""

    gap: int
    """Number of frames from the first to the second."""
    change: ViewChange
    on_arc: BoolArray
    """(M,) whether each match lies on its elevation arc under the true poses."""
    quality: MatchQuality | None
    """By the true elevations; None without them."""


@dataclass(frozen=True)
class LocalisationError:
    """Detected minus true position of the second keypoints of correct matches; both keypoints' errors add up."""

    range_bias_m: float
    range_sigma_m: float
    """Standard deviation about the bias."""
    bearing_bias_rad: float
    bearing_sigma_rad: float
    range_bias_px: float
    """In range bins, of the sonar's median step."""
    range_sigma_px: float
    bearing_bias_px: float
    """In beams, of the sonar's median step."""
    bearing_sigma_px: float


@dataclass(frozen=True)
class MatchStatistics:
    """The matches of many frame pairs; None where the truth that a measure needs is missing, or there is no match."""

    matches: int
    arc_inlier_ratio: float | None
    """Share of matches within :data:`asfm.evaluation.arc_consistency.ARC_TOLERANCE` of their elevation arc."""
    precision: float | None
    recall: float | None
    error: LocalisationError | None


def measure_pairs(
    keypoints: abc.Sequence[Keypoints],
    matches: abc.Iterable[Matches],
    sequence: Sequence,
    read_truth: abc.Callable[[int], FrameTruth] | None,
) -> list[PairStatistics]:
    """Measure the matches of every frame pair of which both true poses are known.

    Args:
        keypoints: one set a frame.
        matches: any frame pairs, frame_a before frame_b.
        sequence: sonar and true poses; without true poses there are no statistics.
        read_truth: returns the true elevations of a frame; None for a recording.

    Raises:
        AsfmError: the truth of a frame cannot be read.
    """
    if sequence.groundtruth is None:
        return []
    known = within_reach(sequence.timestamps_s, sequence.groundtruth.timestamps_s)
    chosen = [pair for pair in matches if known[pair.frame_a] and known[pair.frame_b]]
    world_from_sonar = interpolate_groundtruth(sequence) @ sequence.vehicle_from_sonar
    judged: abc.Iterable[tuple[Matches, MatchQuality | None]] = ((pair, None) for pair in chosen)
    if read_truth is not None:
        judged = evaluate_pairs_by_truth(keypoints, chosen, world_from_sonar, read_truth)
    return [
        PairStatistics(
            gap=pair.frame_b - pair.frame_a,
            change=measure_view_change(world_from_sonar[pair.frame_a], world_from_sonar[pair.frame_b]),
            on_arc=evaluate_pair_by_arcs(keypoints, pair, world_from_sonar, sequence.sonar),
            quality=quality,
        )
        for pair, quality in judged
    ]


def pool_statistics(pairs: abc.Sequence[PairStatistics], sonar: SonarModel) -> MatchStatistics:
    """Pool the matches of frame pairs: every match counts the same.

    Recall counts over the frame pairs that are listed, with or without matches.

    Args:
        pairs: all with true elevations, or all without.
        sonar: steps between range bins and beams.
    """
    on_arc = np.concatenate([np.zeros(0, dtype=bool), *(pair.on_arc for pair in pairs)])
    qualities = [pair.quality for pair in pairs if pair.quality is not None]
    pooled = pool_pairs(qualities)
    return MatchStatistics(
        matches=len(on_arc),
        arc_inlier_ratio=float(on_arc.mean()) if len(on_arc) else None,
        precision=pooled.precision,
        recall=pooled.recall,
        error=_summarise(pooled.range_error_m, pooled.bearing_error_rad, sonar) if pooled.correct else None,
    )


def _summarise(range_error_m: FloatArray, bearing_error_rad: FloatArray, sonar: SonarModel) -> LocalisationError:
    range_m = float(range_error_m.mean()), float(range_error_m.std())
    bearing_rad = float(bearing_error_rad.mean()), float(bearing_error_rad.std())
    in_bins = (value / sonar.range_step_m for value in range_m)
    in_beams = (value / sonar.bearing_step_rad for value in bearing_rad)
    return LocalisationError(*range_m, *bearing_rad, *in_bins, *in_beams)
