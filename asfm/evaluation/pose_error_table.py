"""The table of a run's quality: every error of the estimate with the odometry's own beside it and their ratio."""

from dataclasses import dataclass

import numpy as np

from asfm.errors import AsfmError
from asfm.evaluation.hand_tracks import measure_hand_tracks
from asfm.evaluation.trajectory import (
    PosePairs,
    absolute_errors,
    align_first_pose,
    align_se3,
    associate,
    pairs_by_distance,
    pairs_by_step,
    path_length_m,
    relative_errors,
    summarise,
)
from asfm.sequence import Sequence
from asfm.types import Trajectory

SE3_ALIGNED = "SE(3)-aligned, scale off"
FIRST_POSE_ALIGNED = "first pose aligned, scale off"
SEGMENT_OF_PATH = 0.1
"""Part of the path over which the longer relative errors are taken."""

Measure = tuple[str, float, str]
"""Name, value, unit."""


@dataclass(frozen=True)
class EvaluationRow:
    """One measure of quality."""

    name: str
    """Says the alignment and that the scale is off, wherever a pose error depends on them."""
    value: float
    unit: str
    odometry: float | None = None
    """The same measure of the odometry alone; None where there is none."""
    ratio: float | None = None
    """value / odometry: below one where the run improves on its odometry; None where they cannot be compared."""


@dataclass(frozen=True)
class EvaluationTable:
    """All measures of one run."""

    rows: tuple[EvaluationRow, ...]
    notes: tuple[str, ...] = ()
    """What limits the comparison, one clear sentence each."""

    def as_dict(self) -> dict[str, object]:
        """Turn the table into what JSON holds; every number is finite."""
        return {"rows": [vars(row).copy() for row in self.rows], "notes": list(self.notes)}

    def row(self, name: str) -> EvaluationRow:
        """Find a row by its name; raises KeyError where there is none."""
        for row in self.rows:
            if row.name == name:
                return row
        raise KeyError(name)


def evaluate_sequence(sequence: Sequence, estimate: Trajectory, reference: Trajectory | None = None) -> EvaluationTable:
    """Evaluate an estimate by all that its sequence knows: true poses and hand-tracked points.

    Args:
        sequence: gives odometry, hand-tracked points and, unless a reference is given, the true poses.
        estimate: world_from_vehicle.
        reference: stands in for the sequence's true poses.

    Raises:
        AsfmError: there is nothing to compare with, or no common time.
    """
    truth = reference if reference is not None else sequence.groundtruth
    points = _compare_hand_tracks(sequence, estimate, truth)
    if truth is None and not points:
        raise AsfmError(
            f"{sequence.name}: expected true poses or hand-tracked points that the estimate sees three times, "
            "found neither: give a reference trajectory"
        )
    if truth is None:
        return EvaluationTable(tuple(points), ("No true poses: only the agreement with hand-tracked points is known.",))
    table = evaluate_trajectory(truth, sequence.odometry, estimate)
    return EvaluationTable(table.rows + tuple(points), table.notes)


def evaluate_trajectory(groundtruth: Trajectory, odometry: Trajectory | None, estimate: Trajectory) -> EvaluationTable:
    """Measure an estimate, and the odometry at the same stamps, against the true poses.

    Raises:
        AsfmError: fewer than two poses of the estimate lie within the time of the true poses.
    """
    pairs = associate(estimate, groundtruth)
    notes = []
    if len(pairs) < len(estimate.timestamps_s):
        notes.append(f"{len(pairs)} of {len(estimate.timestamps_s)} poses lie within the reference's time.")
    odometry_pairs = _pair_odometry(pairs, odometry)
    if odometry is not None and (odometry_pairs is None or len(odometry_pairs) < len(pairs)):
        covered = 0 if odometry_pairs is None else len(odometry_pairs)
        notes.append(f"The odometry covers {covered} of the {len(pairs)} poses compared: no ratios are given.")
    beside = {} if odometry_pairs is None else {name: value for name, value, _ in _measure(odometry_pairs)}
    comparable = odometry_pairs is not None and len(odometry_pairs) == len(pairs)
    rows = [
        EvaluationRow("poses compared", float(len(pairs)), "poses"),
        EvaluationRow("path length of the reference", path_length_m(pairs.reference), "m"),
    ]
    rows += [_row(measure, beside.get(measure[0]), comparable) for measure in _measure(pairs)]
    return EvaluationTable(tuple(rows), tuple(notes))


def _pair_odometry(pairs: PosePairs, odometry: Trajectory | None) -> PosePairs | None:
    """Pair the odometry with the reference at the stamps of the estimate that both cover; None where they are few."""
    if odometry is None:
        return None
    try:
        at_stamps = associate(Trajectory(pairs.timestamps_s, pairs.reference), odometry)
    except AsfmError:
        return None
    return PosePairs(at_stamps.timestamps_s, estimate=at_stamps.reference, reference=at_stamps.estimate)


def _measure(pairs: PosePairs) -> list[Measure]:
    path_m = path_length_m(pairs.reference)
    measures: list[Measure] = []
    for alignment, align in ((SE3_ALIGNED, align_se3), (FIRST_POSE_ALIGNED, align_first_pose)):
        aligned = align(pairs.estimate, pairs.reference) @ pairs.estimate
        translation_m, rotation_rad = absolute_errors(aligned, pairs.reference)
        statistics = summarise(translation_m)
        measures += [
            (f"ATE RMSE, {alignment}", statistics.rmse, "m"),
            (f"ATE mean, {alignment}", statistics.mean, "m"),
            (f"ATE median, {alignment}", statistics.median, "m"),
            (f"ATE max, {alignment}", statistics.max, "m"),
        ]
        if path_m > 0:
            measures.append((f"ATE RMSE / path length, {alignment}", 100 * statistics.rmse / path_m, "%"))
        rotation_deg = float(np.degrees(summarise(rotation_rad).rmse))
        measures.append((f"rotation RMSE, {alignment}", rotation_deg, "deg"))
    segments = {
        "one frame": pairs_by_step(len(pairs)),
        f"{100 * SEGMENT_OF_PATH:.0f} % of the path": pairs_by_distance(pairs.reference, SEGMENT_OF_PATH * path_m),
    }
    for segment, (first, last) in segments.items():
        if len(first):
            translation_m, rotation_rad = relative_errors(pairs.estimate, pairs.reference, first, last)
            rotation_deg = float(np.degrees(summarise(rotation_rad).rmse))
            measures.append((f"RPE translation RMSE over {segment}, scale off", summarise(translation_m).rmse, "m"))
            measures.append((f"RPE rotation RMSE over {segment}, scale off", rotation_deg, "deg"))
    return measures


def _compare_hand_tracks(sequence: Sequence, estimate: Trajectory, truth: Trajectory | None) -> list[EvaluationRow]:
    measures = _measure_hand_tracks(sequence, estimate)
    beside = {name: value for name, value, _ in _measure_hand_tracks(sequence, sequence.odometry)}
    rows = [_row(measure, beside.get(measure[0]), comparable=True) for measure in measures]
    for name, value, unit in _measure_hand_tracks(sequence, truth) if rows else []:
        rows.append(EvaluationRow(f"{name} with the true poses", value, unit))
    return rows


def _measure_hand_tracks(sequence: Sequence, trajectory: Trajectory | None) -> list[Measure]:
    if sequence.hand_tracks is None or trajectory is None:
        return []
    found = measure_hand_tracks(sequence.hand_tracks, trajectory, sequence.sonar, sequence.vehicle_from_sonar)
    if found is None:
        return []
    return [
        ("range RMSE of hand-tracked points", found.range_rmse_m, "m"),
        ("bearing RMSE of hand-tracked points", float(np.degrees(found.bearing_rmse_rad)), "deg"),
    ]


def _row(measure: Measure, odometry: float | None, comparable: bool) -> EvaluationRow:
    name, value, unit = measure
    ratio = value / odometry if comparable and odometry is not None and odometry > 1e-12 else None
    return EvaluationRow(name, value, unit, odometry, ratio)
