"""Pose errors of a run as a table: ATE, RPE and hand-tracked points, beside those of the odometry."""

from dataclasses import replace

import numpy as np

from asfm.errors import AsfmError
from asfm.evaluation.association import PosePairs, associate, describe_coverage
from asfm.evaluation.clock_offset import describe_clock_offset
from asfm.evaluation.evaluation_table import EvaluationRow, EvaluationTable
from asfm.evaluation.hand_tracks import measure_hand_tracks
from asfm.evaluation.pose_accuracy import list_accuracy
from asfm.evaluation.reference_jumps import clean_reference
from asfm.evaluation.relative_pose_errors import list_relative_errors
from asfm.evaluation.trajectory import (
    absolute_errors,
    align_first_pose,
    align_rotations,
    align_se3,
    path_length_m,
    stationary_error_m,
    summarise,
)
from asfm.sequence import Sequence
from asfm.types import FloatArray, Trajectory

SE3_ALIGNED = "SE(3)-aligned, scale off"
FIRST_POSE_ALIGNED = "first pose aligned, scale off"
ROTATIONS_ALIGNED = "rotations aligned by themselves"
"""Positions on a nearly straight path hardly determine a rotation about it."""
ATE_RMSE = "ate_rmse_m_se3"
"""Key of the absolute trajectory error, RMSE after SE(3) alignment."""
ATE_OVER_PATH = "ate_over_path_percent_se3"
"""Key of that error over the length of the reference path."""
MIN_ODOMETRY_ERROR = 1e-12
"""No ratio is formed with a smaller error of the odometry."""


def evaluate_sequence(sequence: Sequence, estimate: Trajectory, reference: Trajectory | None = None) -> EvaluationTable:
    """Evaluate an estimate against the true poses and the hand-tracked points of its sequence.

    Args:
        sequence: odometry, hand-tracked points and, without a reference, the true poses.
        estimate: world_from_vehicle.
        reference: true world_from_vehicle in place of the sequence's own.

    Raises:
        AsfmError: there is nothing to compare with, or no common time.
    """
    truth = reference if reference is not None else sequence.groundtruth
    points = _compare_hand_tracks(sequence, estimate, truth and clean_reference(truth, estimate)[0])
    if truth is None and not points:
        raise AsfmError(
            f"{sequence.name}: expected true poses or hand-tracked points observed three times or more, "
            "found neither: give a reference trajectory"
        )
    if truth is None:
        return EvaluationTable(tuple(points), ("No true poses: only the agreement with hand-tracked points is known.",))
    table = evaluate_trajectory(truth, sequence.odometry, estimate)
    return EvaluationTable(table.rows + tuple(points), table.notes)


def evaluate_trajectory(groundtruth: Trajectory, odometry: Trajectory | None, estimate: Trajectory) -> EvaluationTable:
    """Evaluate an estimate, and the odometry at the same stamps, against the true poses.

    Poses of the reference that were not measured are left out, and nothing is interpolated across its gaps; the notes
    say how many poses that concerns, and when.

    Raises:
        AsfmError: fewer than two poses of the estimate have a true pose within reach.
    """
    reference, faults = clean_reference(groundtruth, estimate)
    try:
        pairs = associate(estimate, reference)
    except AsfmError as error:
        raise AsfmError(" ".join([f"{error}.", *faults]) if faults else str(error)) from None
    notes = [*faults, *describe_coverage(estimate.timestamps_s, reference.timestamps_s, pairs)]
    notes += describe_clock_offset(estimate, reference)
    odometry_pairs = _pair_odometry(pairs, odometry)
    comparable = odometry_pairs is not None and len(odometry_pairs) == len(pairs)
    if odometry is not None and not comparable:
        covered = 0 if odometry_pairs is None else len(odometry_pairs)
        notes.append(f"The odometry covers {covered} of the {len(pairs)} poses compared: no ratios are given.")
    errors, shares = _measure(pairs), _measure_accuracy(pairs)
    odometry_errors = [] if odometry_pairs is None else _measure(odometry_pairs)
    odometry_shares = [] if odometry_pairs is None else _measure_accuracy(odometry_pairs)
    rows = [
        EvaluationRow("poses_compared", "poses compared", float(len(pairs)), "poses"),
        EvaluationRow("reference_path_m", "path length of the reference", path_length_m(pairs.reference), "m"),
        EvaluationRow(
            "stationary_ate_rmse_m",
            "ATE RMSE of an estimate that never moves",
            stationary_error_m(pairs.reference),
            "m",
        ),
    ]
    rows += _set_beside(errors, odometry_errors, comparable)
    rows += _set_beside(shares, odometry_shares, comparable=False)
    return EvaluationTable(tuple(rows), tuple(notes))


def _pair_odometry(pairs: PosePairs, odometry: Trajectory | None) -> PosePairs | None:
    """Pair odometry and reference at those stamps of the estimate that both cover; None with fewer than two."""
    if odometry is None:
        return None
    try:
        at_stamps = associate(Trajectory(pairs.timestamps_s, pairs.reference), odometry)
    except AsfmError:
        return None
    return PosePairs(at_stamps.timestamps_s, estimate=at_stamps.reference, reference=at_stamps.estimate)


def _measure_accuracy(pairs: PosePairs) -> list[EvaluationRow]:
    """Measure the shares of poses within thresholds; larger is better."""
    aligned = align_se3(pairs.estimate, pairs.reference) @ pairs.estimate
    translation_m, _ = absolute_errors(aligned, pairs.reference)
    _, rotation_rad = absolute_errors(_turn(pairs), pairs.reference)
    return list_accuracy(translation_m, rotation_rad, path_length_m(pairs.reference))


def _turn(pairs: PosePairs) -> FloatArray:
    """Return the estimate (N, 4, 4) with its rotations aligned by themselves, and its own positions."""
    turned = pairs.estimate.copy()
    turned[:, :3, :3] = align_rotations(turned, pairs.reference) @ turned[:, :3, :3]
    return turned


def _measure(pairs: PosePairs) -> list[EvaluationRow]:
    aligned, from_first = (
        align(pairs.estimate, pairs.reference) @ pairs.estimate for align in (align_se3, align_first_pose)
    )
    return [
        *_position_errors(aligned, pairs.reference, "se3", SE3_ALIGNED),
        _rotation_error(_turn(pairs), pairs.reference, "aligned", ROTATIONS_ALIGNED),
        *_position_errors(from_first, pairs.reference, "first_pose", FIRST_POSE_ALIGNED),
        _rotation_error(from_first, pairs.reference, "first_pose", FIRST_POSE_ALIGNED),
        *list_relative_errors(pairs),
    ]


def _position_errors(aligned: FloatArray, reference: FloatArray, suffix: str, alignment: str) -> list[EvaluationRow]:
    statistics = summarise(absolute_errors(aligned, reference)[0])
    rows = [
        EvaluationRow(f"ate_rmse_m_{suffix}", f"ATE RMSE, {alignment}", statistics.rmse, "m"),
        EvaluationRow(f"ate_mean_m_{suffix}", f"ATE mean, {alignment}", statistics.mean, "m"),
        EvaluationRow(f"ate_median_m_{suffix}", f"ATE median, {alignment}", statistics.median, "m"),
        EvaluationRow(f"ate_max_m_{suffix}", f"ATE max, {alignment}", statistics.max, "m"),
    ]
    path_m = path_length_m(reference)
    if path_m > 0:
        key, name = f"ate_over_path_percent_{suffix}", f"ATE RMSE / path length, {alignment}"
        rows.append(EvaluationRow(key, name, 100 * statistics.rmse / path_m, "%"))
    return rows


def _rotation_error(aligned: FloatArray, reference: FloatArray, suffix: str, alignment: str) -> EvaluationRow:
    rotation_deg = float(np.degrees(summarise(absolute_errors(aligned, reference)[1]).rmse))
    return EvaluationRow(f"rotation_rmse_deg_{suffix}", f"rotation RMSE, {alignment}", rotation_deg, "deg")


def _compare_hand_tracks(sequence: Sequence, estimate: Trajectory, truth: Trajectory | None) -> list[EvaluationRow]:
    rows = _set_beside(
        _measure_hand_tracks(sequence, estimate), _measure_hand_tracks(sequence, sequence.odometry), comparable=True
    )
    for row in _measure_hand_tracks(sequence, truth) if rows else []:
        rows.append(replace(row, key=f"{row.key}_true_poses", name=f"{row.name} with the true poses"))
    return rows


def _measure_hand_tracks(sequence: Sequence, trajectory: Trajectory | None) -> list[EvaluationRow]:
    if sequence.hand_tracks is None or trajectory is None:
        return []
    found = measure_hand_tracks(sequence.hand_tracks, trajectory, sequence.sonar, sequence.vehicle_from_sonar)
    if found is None:
        return []
    bearing_deg = float(np.degrees(found.bearing_rmse_rad))
    return [
        EvaluationRow("hand_track_range_rmse_m", "range RMSE of hand-tracked points", found.range_rmse_m, "m"),
        EvaluationRow("hand_track_bearing_rmse_deg", "bearing RMSE of hand-tracked points", bearing_deg, "deg"),
    ]


def _set_beside(rows: list[EvaluationRow], odometry: list[EvaluationRow], comparable: bool) -> list[EvaluationRow]:
    """Add the odometry's value of the same measure to each row, and their ratio where they are comparable."""
    values = {row.key: row.value for row in odometry}
    completed = []
    for row in rows:
        value = values.get(row.key)
        ratio = row.value / value if comparable and value is not None and value > MIN_ODOMETRY_ERROR else None
        completed.append(replace(row, odometry=value, ratio=ratio))
    return completed
