"""Metrics of a cell: quality of its matches and of its poses, against as much truth as its sequence has."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from asfm.errors import AsfmError
from asfm.evaluation.accuracy_bound import measure_bound
from asfm.evaluation.association import within_reach
from asfm.evaluation.matching import MatchQuality, evaluate_by_arcs, evaluate_by_truth, pool_pairs
from asfm.evaluation.mirror_image import ATE_RMSE_MIRRORED, add_mirror_image
from asfm.evaluation.pose_error_table import ATE_OVER_PATH, ATE_RMSE, EvaluationTable, evaluate_sequence
from asfm.evaluation.trajectory import interpolate_groundtruth
from asfm.pipeline import Run
from asfm.sequence import Sequence
from asfm.study.cell import Cell
from asfm.study.match_corruption import CorruptedMatches
from asfm.study.sequence_provider import StudySequence
from asfm.types import FloatArray, Matches

Values = dict[str, Any]
POSE_METRICS = {
    "stationary_ate_m": "stationary_ate_rmse_m",
    "ate_over_path_percent": ATE_OVER_PATH,
    "rotation_rmse_deg": "rotation_rmse_deg_aligned",
    "rpe_translation_m": "rpe_translation_rmse_m_segment",
    "rpe_rotation_deg": "rpe_rotation_rmse_deg_segment",
}
"""Columns that are rows of the evaluation of poses, by their keys there."""


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
        return {**values, "missing": "no true elevations: precision, recall, noise and bound"}
    if cell.bound_draws:
        bound = measure_bound(
            sequence, opened.read_truth, result.tracks, result.observed, cell.config, cell.bound_draws
        ).ate_m
        values |= {"bound_ate_m": bound, "ate_over_bound": values["ate_m"] / bound if bound > 0 else None}
    return {**values, "missing": "" if cell.bound_draws else "no draws of the noise: bound"}


def _measure_poses(cell: Cell, run: Run, sequence: Sequence) -> Values:
    """Return the pose errors after SE(3) alignment without scale; for a sonar alone, the nearer of both mirror images.

    The sonar alone cannot tell a solution from its mirror image: the column ``mirror_aware`` says where that is done.
    """
    estimate = run.reconstruction.trajectory
    table = evaluate_sequence(sequence, estimate)
    row = table.row(ATE_RMSE)
    ate_m = row.value
    if cell.mode == "sonar":
        ate_m = min(ate_m, add_mirror_image(table, sequence, estimate).row(ATE_RMSE_MIRRORED).value)
    odometry_m = row.odometry if row.ratio is not None else None
    return {
        "ate_m": ate_m,
        "mirror_aware": cell.mode == "sonar",
        "ate_as_it_is_m": row.value,
        "odometry_ate_m": odometry_m,
        "ate_over_odometry": ate_m / odometry_m if odometry_m else None,
        **{column: _find(table, key) for column, key in POSE_METRICS.items()},
    }


def _find(table: EvaluationTable, key: str) -> float | None:
    return next((row.value for row in table.rows if row.key == key), None)


def _measure_matches(run: Run, opened: StudySequence) -> Values:
    """Return precision, recall and noise by true elevations, and the share of matches on their elevation arcs."""
    sequence = opened.sequence
    assert sequence.groundtruth is not None
    known = within_reach(sequence.timestamps_s, sequence.groundtruth.timestamps_s)
    matches = [match for match in run.matches if known[match.frame_a] and known[match.frame_b]]
    world_from_sonar = interpolate_groundtruth(sequence) @ sequence.vehicle_from_sonar
    values: Values = {"arc_inlier_ratio": _arc_inlier_ratio(run, matches, world_from_sonar, sequence)}
    if opened.read_truth is None:
        return values
    quality = pool_pairs(evaluate_by_truth(run.keypoints, matches, world_from_sonar, opened.read_truth).values())
    return {**values, "precision": quality.precision, "recall": quality.recall, **_measure_noise(quality, sequence)}


def _arc_inlier_ratio(
    run: Run, matches: list[Matches], world_from_sonar: FloatArray, sequence: Sequence
) -> float | None:
    inlier = evaluate_by_arcs(run.keypoints, matches, world_from_sonar, sequence.sonar)
    every = np.concatenate([np.zeros(0), *inlier.values()])
    return float(every.mean()) if len(every) else None


def _measure_noise(quality: MatchQuality, sequence: Sequence) -> Mapping[str, float | None]:
    """Return the noise of one keypoint: the errors of correct matches hold that of two."""
    if quality.correct < 2:
        return {"range_noise_bins": None, "bearing_noise_beams": None}
    sigma_m, sigma_rad = (
        float(np.std(error) / np.sqrt(2)) for error in (quality.range_error_m, quality.bearing_error_rad)
    )
    return {
        "range_noise_bins": sigma_m / sequence.sonar.range_step_m,
        "bearing_noise_beams": sigma_rad / sequence.sonar.bearing_step_rad,
    }


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
