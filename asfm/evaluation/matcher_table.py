"""Matcher quality as rows of the evaluation table: per frame gap, per view change and over all."""

from collections import abc
from dataclasses import fields, replace

import numpy as np

from asfm.evaluation.evaluation_table import EvaluationRow
from asfm.evaluation.image_coverage import GRID
from asfm.evaluation.match_statistics import (
    LocalisationError,
    MatchStatistics,
    PairStatistics,
    measure_pairs,
    pool_statistics,
)
from asfm.evaluation.matcher_quality import NEEDS_POSES, MatcherQuality, summarise_matcher, usable_truth
from asfm.evaluation.view_change import Bin, distance_bins, find_distance_bin, find_rotation_bin, rotation_bins
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import FrameTruth, Keypoints, Matches, Tracks

PRINTED_GAPS = (1, 2, 4, 8)
"""Frame gaps that are printed; evaluation.json has all."""
LONGEST_GAP = 8
"""Longer gaps, as of loop closures, are pooled."""
OVERALL = Bin("overall", "all frame pairs")


def evaluate_matcher(
    keypoints: abc.Sequence[Keypoints],
    matches: abc.Iterable[Matches],
    tracks: Tracks,
    sequence: Sequence,
    read_truth: abc.Callable[[int], FrameTruth] | None,
) -> tuple[tuple[EvaluationRow, ...], tuple[str, ...]]:
    """Evaluate features, matches and tracks of a run for a table.

    Args:
        keypoints: one set a frame.
        matches: any frame pairs, frame_a before frame_b.
        tracks: of these keypoints.
        sequence: sonar and, where known, true poses.
        read_truth: returns the true elevations of a frame; None for a recording.

    Returns:
        Rows with keys such as ``match_precision_gap_1`` or ``match_recall_overall``, and a note on the measures that
        are left out for want of truth.

    Raises:
        AsfmError: the truth of a frame cannot be read.
    """
    listed, read_truth = list(matches), usable_truth(sequence, read_truth)
    pairs = measure_pairs(keypoints, listed, sequence, read_truth)
    quality = summarise_matcher(pairs, keypoints, listed, tracks, sequence, read_truth)
    rows = _list_groups(pairs, sequence.sonar) + _list_overall(quality)
    return tuple(rows), describe_left_out(quality.left_out)


def describe_left_out(measures: tuple[str, ...]) -> tuple[str, ...]:
    """Return a note on measures that are left out for want of truth; nothing where none is."""
    if not measures:
        return ()
    needed = "poses" if set(measures) & set(NEEDS_POSES) else "elevations of every frame"
    return (f"Matcher quality is without {', '.join(measures)}: these need true {needed}.",)


def _list_groups(pairs: abc.Sequence[PairStatistics], sonar: SonarModel) -> list[EvaluationRow]:
    """Return the rows of every frame gap and of every bin of view changes that occurs."""
    rows: list[EvaluationRow] = []
    for groups, group_of in (
        (_gap_bins(), _find_gap_bin),
        (rotation_bins(), lambda pair: find_rotation_bin(pair.change)),
        (distance_bins(), lambda pair: find_distance_bin(pair.change)),
    ):
        for group in groups:
            members = [pair for pair in pairs if group_of(pair) == group]
            if members:
                rows += _list_statistics(group, pool_statistics(members, sonar))
    return rows


def _gap_bins() -> tuple[Bin, ...]:
    longer = LONGEST_GAP + 1
    named = (Bin(f"gap_{gap}", f"frame gap {gap}") for gap in range(1, longer))
    return (*named, Bin(f"gap_{longer}_and_more", f"frame gap {longer} and more"))


def _find_gap_bin(pair: PairStatistics) -> Bin:
    return _gap_bins()[min(pair.gap, LONGEST_GAP + 1) - 1]


def _list_statistics(group: Bin, statistics: MatchStatistics) -> list[EvaluationRow]:
    """Return the rows of one group; a measure without a value has none."""
    printed = group == OVERALL or group.key in {f"gap_{gap}" for gap in PRINTED_GAPS}
    shares = (
        ("precision", "precision", statistics.precision),
        ("recall", "recall", statistics.recall),
        ("arc_inlier_ratio", "arc inlier ratio", statistics.arc_inlier_ratio),
    )
    rows = [EvaluationRow(f"match_count_{group.key}", f"matches, {group.name}", float(statistics.matches), "matches")]
    for key, name, value in shares:
        if value is not None:
            rows.append(EvaluationRow(f"match_{key}_{group.key}", f"match {name}, {group.name}", value, ""))
    rows = [replace(row, detail=not printed) for row in rows]
    return rows + (_list_errors(group, statistics.error) if statistics.error is not None else [])


def _list_errors(group: Bin, error: LocalisationError) -> list[EvaluationRow]:
    """Return the localisation error as rows; angles in degrees, pixels as range bins and beams."""
    rows = []
    for field in fields(error):
        axis, measure, unit = field.name.split("_")
        value = getattr(error, field.name)
        if unit == "rad":
            unit, value = "deg", float(np.degrees(value))
        shown = {"px": "range bins" if axis == "range" else "beams"}.get(unit, unit)
        name = f"{axis} {measure} of correct matches in {shown}, {group.name}"
        rows.append(EvaluationRow(f"match_{axis}_{measure}_{unit}_{group.key}", name, value, shown, detail=True))
    return rows


def _list_overall(quality: MatcherQuality) -> list[EvaluationRow]:
    statistics = MatchStatistics(
        quality.matches, quality.arc_inlier_ratio, quality.precision, quality.recall, quality.error
    )
    rows, columns = GRID
    cells = f"share of {rows} x {columns} cells of the image"
    others = (
        ("track_count", "tracks", float(quality.tracks), "tracks"),
        ("track_length_mean", "observations of a track, mean", quality.track_length, ""),
        ("track_length_median", "observations of a track, median", quality.track_length_median, ""),
        ("track_purity", "share of a track's observations of its true point", quality.track_purity, ""),
        ("keypoint_coverage", f"{cells} with a keypoint", quality.keypoint_coverage, ""),
        ("match_coverage", f"{cells} with a matched keypoint", quality.match_coverage, ""),
    )
    named = [EvaluationRow(key, name, value, unit) for key, name, value, unit in others if value is not None]
    return _list_statistics(OVERALL, statistics) + named
