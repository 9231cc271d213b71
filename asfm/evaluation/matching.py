"""Precision and recall of feature matches per frame gap: against true elevations, or against elevation arcs.

A simulation knows each keypoint's elevation and so its exact position in the other frame. Where only true
poses are known, matches are evaluated by their elevation arcs (:mod:`asfm.evaluation.arc_consistency`).
"""

from collections import abc, defaultdict
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from asfm.evaluation.arc_consistency import Tolerance, find_arc_inliers
from asfm.evaluation.association import within_reach
from asfm.evaluation.pose_error_table import EvaluationRow
from asfm.evaluation.trajectory import interpolate_groundtruth
from asfm.evaluation.true_positions import TRUTH_TOLERANCE, TruePositions, find_true_positions
from asfm.geometry.poses import invert, wrap_angle
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, FrameTruth, Keypoints, Matches

REPORTED_GAPS = (1, 2, 4, 8)
"""Frame gaps that are reported by default."""


@dataclass(frozen=True)
class MatchQuality:
    """Correct matches of one frame pair, or of many."""

    matches: int
    possible: int
    """Keypoints of the first frame with a correct partner among the keypoints of the second."""
    recalled: int
    """Those of them with a correct match."""
    range_error_m: FloatArray
    """(C,) of the correct matches, detected minus true; the localisation errors of both keypoints add up."""
    bearing_error_rad: FloatArray
    """(C,) of the correct matches, detected minus true."""

    @property
    def correct(self) -> int:
        """Number of correct matches."""
        return len(self.range_error_m)

    @property
    def precision(self) -> float | None:
        """Correct matches over all matches; None without matches."""
        return self.correct / self.matches if self.matches else None

    @property
    def recall(self) -> float | None:
        """Recalled keypoints over all that could be matched correctly; None where none could."""
        return self.recalled / self.possible if self.possible else None


def evaluate_pair(
    truth: TruePositions, keypoints_b: Keypoints, matches: Matches, tolerance: Tolerance = TRUTH_TOLERANCE
) -> MatchQuality:
    """Evaluate the matches of one frame pair.

    Args:
        truth: (K) true positions of frame a's keypoints in frame b.
        keypoints_b: of frame b.
        matches: (M) of frames a and b.
        tolerance: largest errors of a correct match in range and bearing, both inclusive.
    """
    a, b = matches.index[:, 0], matches.index[:, 1]
    range_error_m = keypoints_b.range_m[b] - truth.range_m[a]
    bearing_error_rad = wrap_angle(keypoints_b.bearing_rad[b] - truth.bearing_rad[a])
    correct = _within(range_error_m, bearing_error_rad, tolerance) & truth.known[a]
    near = _within(
        keypoints_b.range_m - truth.range_m[:, None],
        wrap_angle(keypoints_b.bearing_rad - truth.bearing_rad[:, None]),
        tolerance,
    )
    return MatchQuality(
        matches=len(matches),
        possible=int((near.any(axis=1) & truth.known).sum()),
        recalled=len(np.unique(a[correct])),
        range_error_m=range_error_m[correct],
        bearing_error_rad=bearing_error_rad[correct],
    )


def pool_pairs(qualities: abc.Iterable[MatchQuality]) -> MatchQuality:
    """Add up the counts and concatenate the errors of many frame pairs."""
    parts = list(qualities)
    return MatchQuality(
        matches=sum(part.matches for part in parts),
        possible=sum(part.possible for part in parts),
        recalled=sum(part.recalled for part in parts),
        range_error_m=np.concatenate([np.zeros(0), *(part.range_error_m for part in parts)]),
        bearing_error_rad=np.concatenate([np.zeros(0), *(part.bearing_error_rad for part in parts)]),
    )


def evaluate_by_truth(
    keypoints: abc.Sequence[Keypoints],
    matches: abc.Iterable[Matches],
    world_from_sonar: FloatArray,
    read_truth: abc.Callable[[int], FrameTruth],
) -> dict[int, MatchQuality]:
    """Evaluate matches by the true elevations of a simulation.

    Args:
        keypoints: one set a frame.
        matches: any frame pairs, frame_a before frame_b.
        world_from_sonar: (N, 4, 4) true poses of the frames.
        read_truth: returns the truth of a frame; called once for each frame_a.

    Returns:
        The pooled quality of each frame gap that occurs, in rising order.

    Raises:
        AsfmError: the truth of a frame cannot be read.
    """
    found: dict[int, list[MatchQuality]] = defaultdict(list)
    for frame_a, pairs in groupby(sorted(matches, key=_frame_a), key=_frame_a):
        elevation_rad = read_truth(frame_a).elevation_rad
        for pair in pairs:
            b_from_a = invert(world_from_sonar[pair.frame_b]) @ world_from_sonar[frame_a]
            truth = find_true_positions(keypoints[frame_a], elevation_rad, b_from_a)
            found[pair.frame_b - frame_a].append(evaluate_pair(truth, keypoints[pair.frame_b], pair))
    return {gap: pool_pairs(found[gap]) for gap in sorted(found)}


def evaluate_by_arcs(
    keypoints: abc.Sequence[Keypoints], matches: abc.Iterable[Matches], world_from_sonar: FloatArray, sonar: SonarModel
) -> dict[int, BoolArray]:
    """Evaluate matches by their elevation arcs under true poses.

    Args:
        keypoints: one set a frame.
        matches: any frame pairs, frame_a before frame_b.
        world_from_sonar: (N, 4, 4) true poses of the frames.
        sonar: elevation aperture.

    Returns:
        For each frame gap that occurs, in rising order, which of all its (M,) matches lie on their arc.
    """
    found: dict[int, list[BoolArray]] = defaultdict(list)
    for pair in matches:
        b_from_a = invert(world_from_sonar[pair.frame_b]) @ world_from_sonar[pair.frame_a]
        pixel_a, pixel_b = (
            np.stack([frame.range_m[index], frame.bearing_rad[index]], axis=1)
            for frame, index in zip((keypoints[pair.frame_a], keypoints[pair.frame_b]), pair.index.T, strict=True)
        )
        found[pair.frame_b - pair.frame_a].append(find_arc_inliers(pixel_a, pixel_b, b_from_a, sonar))
    return {gap: np.concatenate(found[gap]) for gap in sorted(found)}


def evaluate_matching(
    keypoints: abc.Sequence[Keypoints],
    matches: abc.Iterable[Matches],
    sequence: Sequence,
    read_truth: abc.Callable[[int], FrameTruth] | None,
    gaps: abc.Iterable[int] = REPORTED_GAPS,
) -> tuple[EvaluationRow, ...]:
    """Evaluate the matches of a run for a table: numbers, precision and recall, or arc inlier ratio, per frame gap.

    Precision and recall need the true elevations of a simulation; without them, true poses give the arc inlier ratio.
    Recall counts over the frame pairs that are listed, with or without matches.

    Args:
        keypoints: one set a frame.
        matches: any frame pairs, frame_a before frame_b.
        sequence: sonar and true poses.
        read_truth: returns the truth of a frame; None for a recording.
        gaps: frame gaps to report; those that do not occur have no rows.

    Returns:
        Rows with keys such as ``match_precision_gap_1``; none where the sequence has no true poses.

    Raises:
        AsfmError: the truth of a frame cannot be read.
    """
    if sequence.groundtruth is None:
        return ()
    reported = set(gaps)
    known = within_reach(sequence.timestamps_s, sequence.groundtruth.timestamps_s)
    chosen = [
        pair
        for pair in matches
        if pair.frame_b - pair.frame_a in reported and known[pair.frame_a] and known[pair.frame_b]
    ]
    world_from_sonar = interpolate_groundtruth(sequence) @ sequence.vehicle_from_sonar
    rows: list[EvaluationRow] = []
    if read_truth is None:
        for gap, inlier in evaluate_by_arcs(keypoints, chosen, world_from_sonar, sequence.sonar).items():
            ratio = float(inlier.mean()) if len(inlier) else None
            rows += _list_rows(gap, len(inlier), (("arc_inlier_ratio", "arc inlier ratio", ratio),))
        return tuple(rows)
    for gap, quality in evaluate_by_truth(keypoints, chosen, world_from_sonar, read_truth).items():
        measures = (("precision", "precision", quality.precision), ("recall", "recall", quality.recall))
        rows += _list_rows(gap, quality.matches, measures)
    return tuple(rows)


def _list_rows(gap: int, count: int, measures: abc.Iterable[tuple[str, str, float | None]]) -> list[EvaluationRow]:
    """Return the rows of one frame gap; a measure without a value has none."""
    where = f"frame gap {gap}"
    rows = [EvaluationRow(f"match_count_gap_{gap}", f"matches, {where}", float(count), "matches")]
    for key, name, value in measures:
        if value is not None:
            rows.append(EvaluationRow(f"match_{key}_gap_{gap}", f"match {name}, {where}", value, ""))
    return rows


def _frame_a(matches: Matches) -> int:
    return matches.frame_a


def _within(range_error_m: FloatArray, bearing_error_rad: FloatArray, tolerance: Tolerance) -> BoolArray:
    in_range = np.abs(range_error_m) <= tolerance.range_m
    return np.asarray(in_range & (np.abs(bearing_error_rad) <= tolerance.bearing_rad))
