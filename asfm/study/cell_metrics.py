"""Metrics of a cell: quality of its matches and of its poses, against as much truth as its sequence has."""

from dataclasses import replace
from typing import Any

import numpy as np

from asfm.errors import AsfmError
from asfm.evaluation.accuracy_bound import measure_bound
from asfm.evaluation.evaluation_table import EvaluationTable
from asfm.evaluation.match_statistics import LocalisationError, PairStatistics, measure_pairs, pool_statistics
from asfm.evaluation.matcher_quality import summarise_matcher, usable_truth
from asfm.evaluation.pose_error_table import ATE_OVER_PATH, ATE_RMSE, evaluate_sequence
from asfm.geometry.reflection import reflect_after
from asfm.geometry.sonar import SonarModel
from asfm.pipeline import Run
from asfm.sequence import Sequence
from asfm.study.cell import Cell
from asfm.study.match_corruption import CorruptedMatches
from asfm.study.results_table import GAPS, gap_column
from asfm.study.sequence_provider import StudySequence

Values = dict[str, Any]
POSE_METRICS = {
    "stationary_ate_m": "stationary_ate_rmse_m",
    "ate_over_path_percent": ATE_OVER_PATH,
    "rotation_rmse_deg": "rotation_rmse_deg_aligned",
    "rpe_translation_m": "rpe_translation_rmse_m_segment",
    "rpe_rotation_deg": "rpe_rotation_rmse_deg_segment",
}
"""Columns that are rows of the evaluation of poses, by their keys there."""
MATCH_METRICS = (
    *("precision", "recall", "arc_inlier_ratio", "range_bias_m", "bearing_bias_rad"),
    *("track_purity", "keypoint_coverage", "match_coverage"),
)
"""Columns that are measures of the matcher, by their names there."""


def measure_cell(cell: Cell, run: Run, opened: StudySequence, corrupted: CorruptedMatches | None) -> Values:
    """Measure all that the truth of a sequence allows; metrics that need more are left out, and named in ``missing``.

    Args:
        cell: what was run.
        run: its result.
        opened: its sequence.
        corrupted: the matches where they were made from true ones, with their known quality.
    """
    sequence, result = opened.sequence, run.reconstruction
    views = np.bincount(result.tracks.track[result.observed], minlength=1)
    values: Values = {
        "frames": len(sequence),
        "keypoints_per_frame": float(np.mean([len(frame) for frame in run.keypoints])),
        "matches": sum(len(match) for match in run.matches),
        "track_length": float(views[views > 0].mean()) if views.any() else None,
        "warnings": " ".join(dict.fromkeys(found.code for found in result.diagnostics)),
    }
    if sequence.groundtruth is None:
        return {**values, "missing": "no true poses: pose errors, precision and recall"}
    values |= _measure_poses(cell, run, sequence)
    values |= _measure_matches(run, opened) if corrupted is None else _list_known(corrupted, cell)
    if opened.read_truth is None:
        return {**values, "missing": "no true elevations: precision, recall, noise, purity and bound"}
    if cell.bound_draws:
        bound = measure_bound(
            sequence, opened.read_truth, result.tracks, result.observed, cell.config, cell.bound_draws
        ).ate_m
        values |= {"bound_ate_m": bound, "ate_over_bound": values["ate_m"] / bound if bound > 0 else None}
    return {**values, "missing": "" if cell.bound_draws else "no draws of the noise: bound"}


def _measure_poses(cell: Cell, run: Run, sequence: Sequence) -> Values:
    """Return the pose errors after SE(3) alignment without scale; for a sonar alone, all of the nearer mirror image.

    The sonar alone cannot tell a solution from its mirror image: the column ``mirror_aware`` says where that is done.
    """
    estimate = run.reconstruction.trajectory
    own = table = evaluate_sequence(sequence, estimate)
    if cell.mode == "sonar":
        mirrored = reflect_after(estimate.world_from_vehicle, 0, sequence.vehicle_from_sonar)
        other = evaluate_sequence(sequence, replace(estimate, world_from_vehicle=mirrored))
        table = min(own, other, key=lambda found: found.row(ATE_RMSE).value)
    row = table.row(ATE_RMSE)
    odometry_m = row.odometry if row.ratio is not None else None
    return {
        "ate_m": row.value,
        "mirror_aware": cell.mode == "sonar",
        "ate_as_it_is_m": own.row(ATE_RMSE).value,
        "odometry_ate_m": odometry_m,
        "ate_over_odometry": row.value / odometry_m if odometry_m else None,
        **{column: _find(table, key) for column, key in POSE_METRICS.items()},
    }


def _find(table: EvaluationTable, key: str) -> float | None:
    return next((row.value for row in table.rows if row.key == key), None)


def _measure_matches(run: Run, opened: StudySequence) -> Values:
    """Return precision, recall, noise and purity by true elevations, and the share of matches on their elevation arcs.

    Precision, that share and the noise are also those of each frame gap of GAPS that occurs.
    """
    sequence, tracks = opened.sequence, run.reconstruction.tracks
    read_truth = usable_truth(sequence, opened.read_truth)
    pairs = measure_pairs(run.keypoints, run.matches, sequence, read_truth)
    quality = summarise_matcher(pairs, run.keypoints, run.matches, tracks, sequence, read_truth)
    by_name = quality.as_dict()
    values: Values = {name: by_name[name] for name in MATCH_METRICS if by_name[name] is not None}
    return values | _measure_noise(quality.error) | _measure_gaps(pairs, sequence.sonar)


def _measure_noise(error: LocalisationError | None) -> Values:
    """Return the noise of one keypoint: the errors of correct matches hold that of two."""
    if error is None:
        return {}
    pixels = {"range_noise_bins": error.range_sigma_px, "bearing_noise_beams": error.bearing_sigma_px}
    return {name: sigma_px / float(np.sqrt(2.0)) for name, sigma_px in pixels.items()}


def _measure_gaps(pairs: list[PairStatistics], sonar: SonarModel) -> Values:
    """Return the measures of the matches of each frame gap; what is unknown is left out."""
    values: Values = {}
    for gap in GAPS:
        pooled = pool_statistics([pair for pair in pairs if pair.gap == gap], sonar)
        own = {"precision": pooled.precision, "arc_inlier_ratio": pooled.arc_inlier_ratio}
        own |= _measure_noise(pooled.error)
        values |= {gap_column(name, gap): value for name, value in own.items() if value is not None}
    return values


def _list_known(corrupted: CorruptedMatches, cell: Cell) -> Values:
    assert cell.corruption is not None
    return {
        "precision": corrupted.precision,
        "recall": corrupted.recall,
        "range_noise_bins": cell.corruption.range_noise_bins,
        "bearing_noise_beams": cell.corruption.bearing_noise_beams,
    }


def describe_failure(error: Exception) -> str:
    """Return the line of a cell that failed: that of bad input as it is, any other with the name of its exception."""
    text = " ".join(str(error).split())[:300]
    return text if isinstance(error, AsfmError) else f"defect, {type(error).__name__}: {text}"
