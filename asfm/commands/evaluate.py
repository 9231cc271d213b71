"""Command ``asfm evaluate``: compare the results of a run with ground truth."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from asfm.config import Config
from asfm.config_file import load_config
from asfm.datasets import open_sequence, open_truth
from asfm.datasets.hloc.features_matches import read_hloc
from asfm.datasets.hloc.image_names import name_images
from asfm.datasets.tables import read_tum
from asfm.errors import AsfmError
from asfm.evaluation.association import within_reach
from asfm.evaluation.covariance_consistency import evaluate_consistency
from asfm.evaluation.evaluation_table import EvaluationTable
from asfm.evaluation.matcher_quality import NEEDS_ELEVATIONS, NEEDS_POSES
from asfm.evaluation.matcher_table import describe_left_out, evaluate_matcher
from asfm.evaluation.mirror_image import MIRROR_AMBIGUITY, add_mirror_image
from asfm.evaluation.pose_error_table import evaluate_sequence, evaluate_trajectory
from asfm.evaluation.reference_jumps import clean_reference
from asfm.frame_selection import choose_frames, take_frames, take_truth
from asfm.geometry.local_origin import local_origin, shift_poses
from asfm.geometry.poses import interpolate, invert, pose_log
from asfm.navigation.local_world import shift_poses_of
from asfm.regular_file import is_present
from asfm.results.evaluation_json import write_evaluation
from asfm.results.points_ply import read_points
from asfm.results.pose_covariances_csv import read_pose_covariances
from asfm.results.report_json import read_report, warning_codes
from asfm.results.results_folder import CONFIG, FEATURES, MATCHES, POINTS, POSE_COVARIANCES, TRACKS, TRAJECTORY
from asfm.results.tracks_csv import read_tracks
from asfm.results.trajectory_tum import read_trajectory
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, IntArray, Trajectory

NEEDED = (TRACKS, POINTS, POSE_COVARIANCES, FEATURES, MATCHES)
"""Files that the comparison with ground truth reads besides the trajectory."""
STAMP_TOLERANCE_S = 1e-5
"""asfm writes the stamps of a trajectory exactly; other programs that save it round them."""
SAME_WORLD_RAD, SAME_WORLD_M = 0.2, 1.0
"""Odometry and true poses that start this near each other are in one world."""


def evaluate_folder(folder: Path, reference: Path | None = None) -> EvaluationTable:
    """Compare a run's trajectory with ground truth and, for a simulated sequence, with the bound of ideal features.

    Writes evaluation.json into the folder.

    Args:
        folder: results folder; its report names the sequence, which has the true poses and the odometry.
        reference: TUM file of true world_from_vehicle poses that replaces those of the sequence; the bound is then
            not computed.

    Raises:
        AsfmError: the folder, the sequence or the reference cannot be read, there are no true poses, or
            evaluation.json cannot be written.
    """
    table = compare_with_truth(folder, reference)
    if reference is not None:
        table = replace(table, reference=str(reference.resolve()))
    write_evaluation(folder, table)
    return table


def compare_with_truth(folder: Path, reference: Path | None = None) -> EvaluationTable:
    """Compare as :func:`evaluate_folder`, and write nothing.

    Raises:
        AsfmError: the folder, the sequence or the reference cannot be read, or there are no true poses.
    """
    source = Path(read_report(folder)["sequence"]["path"])
    estimate = read_trajectory(folder / TRAJECTORY)
    truth = read_tum(reference, may_be_lost=True) if reference is not None else None
    return _compare(folder, source, estimate, truth)


def _compare(folder: Path, source: Path, estimate: Trajectory, truth: Trajectory | None) -> EvaluationTable:
    """Compare with all that the sequence provides; without the sequence, with the reference alone."""
    try:
        whole = open_sequence(source)
    except AsfmError as error:
        if truth is None:
            raise AsfmError(f"{error}; or give a reference trajectory (--reference)") from None
        table = evaluate_trajectory(truth, None, estimate)
        return EvaluationTable(table.rows, (*table.notes, f"Without the odometry's row: {error}."))
    chosen = choose_frames(whole, _read_config(folder).frames)
    sequence = take_frames(whole, chosen)
    table = evaluate_sequence(sequence, estimate, truth)
    if MIRROR_AMBIGUITY in warning_codes(read_report(folder)):
        table = add_mirror_image(table, sequence, estimate, truth)
    if truth is not None:
        return _add_matches(folder, source, whole, chosen, table, clean_reference(truth, estimate)[0])
    return _add_truth(folder, source, whole, chosen, table)


def _read_config(folder: Path) -> Config:
    """Read the configuration of a run; the defaults where an older version wrote none."""
    return load_config(folder / CONFIG) if is_present(folder / CONFIG) else Config()


def _add_truth(
    folder: Path, source: Path, whole: Sequence, chosen: IntArray, table: EvaluationTable
) -> EvaluationTable:
    """Add the evaluation of covariances and matches and the accuracy bound, or a note on what is missing."""
    sequence = take_frames(whole, chosen)
    if sequence.groundtruth is None:
        return EvaluationTable(table.rows, table.notes + describe_left_out(NEEDS_POSES + NEEDS_ELEVATIONS))
    missing = [name for name in NEEDED if not is_present(folder / name)]
    if missing:
        note = f"The results hold no {missing[0]}, which older versions did not write; run asfm run again for all rows."
        return EvaluationTable(table.rows, (*table.notes, note))
    whole_truth, config = open_truth(source), load_config(folder / CONFIG)
    read_truth = whole_truth and take_truth(whole_truth, chosen)
    estimate = read_trajectory(folder / TRAJECTORY)
    _check_frames(folder / TRAJECTORY, estimate, sequence)
    truth, _ = clean_reference(sequence.groundtruth, estimate)
    if read_truth is not None and not within_reach(sequence.timestamps_s, truth.timestamps_s).all():
        note = "The true poses do not cover all frames: their elevations, and the bound made from them, are not used."
        read_truth, table = None, EvaluationTable(table.rows, (*table.notes, note))
    own_world = not _starts_at_truth(sequence, config)
    poses, truth_m = estimate.world_from_vehicle, truth.world_from_vehicle[:, :3, 3]
    origin_m = local_origin(poses[:, :3, 3] if own_world else truth_m)
    sequence = shift_poses_of(replace(sequence, groundtruth=truth), -local_origin(truth_m))
    tracks, observed, landmark = read_tracks(folder / TRACKS, len(sequence))
    rows = evaluate_consistency(
        shift_poses(poses, -origin_m),
        read_pose_covariances(folder / POSE_COVARIANCES, len(sequence)),
        _read_landmarks(folder / POINTS, landmark, origin_m),
        tracks,
        sequence,
        read_truth,
        own_world,
    )
    notes = table.notes
    if len(sequence) > 1:
        found = read_hloc(folder / FEATURES, folder / MATCHES, sequence, name_images(source, whole).take(chosen))
        of_matcher, remarks = evaluate_matcher(found.keypoints, found.matches, tracks, sequence, read_truth)
        rows, notes = rows + of_matcher, notes + remarks
    table = EvaluationTable(table.rows + rows, notes)
    if read_truth is None:
        return table
    from asfm.evaluation.accuracy_bound import add_bound, measure_bound  # loads SciPy

    return add_bound(table, measure_bound(sequence, read_truth, tracks, observed, config))


def _add_matches(
    folder: Path, source: Path, whole: Sequence, chosen: IntArray, table: EvaluationTable, reference: Trajectory
) -> EvaluationTable:
    """Add the quality of the matches under reference poses; true elevations would belong to the sequence's own."""
    if len(chosen) < 2 or not all(is_present(folder / name) for name in (TRACKS, FEATURES, MATCHES)):
        return table
    origin_m = local_origin(reference.world_from_vehicle[:, :3, 3])
    sequence = shift_poses_of(replace(take_frames(whole, chosen), groundtruth=reference), -origin_m)
    found = read_hloc(folder / FEATURES, folder / MATCHES, sequence, name_images(source, whole).take(chosen))
    tracks, _, _ = read_tracks(folder / TRACKS, len(sequence))
    rows, remarks = evaluate_matcher(found.keypoints, found.matches, tracks, sequence, None)
    return EvaluationTable(table.rows + rows, table.notes + remarks)


def _check_frames(path: Path, estimate: Trajectory, sequence: Sequence) -> None:
    """Check that a run's trajectory has the frames of the sequence."""
    found, expected = estimate.timestamps_s, sequence.timestamps_s
    if len(found) != len(expected):
        what = f"a pose for each of the {len(expected)} frames of the sequence, found {len(found)}"
        raise AsfmError(f"{path}: expected {what}; run asfm run again")
    for frame in np.flatnonzero(np.abs(found - expected) > STAMP_TOLERANCE_S)[:1]:
        what = f"the stamp {expected[frame]:.6f} s of frame {frame} of the sequence, found {found[frame]:.6f} s"
        raise AsfmError(f"{path}: expected {what}; run asfm run again")


@dataclass(frozen=True)
class _Landmarks:
    """The landmarks of a results folder, with their tracks."""

    track: IntArray
    xyz_m: FloatArray
    sigma_m: FloatArray
    well_constrained: BoolArray


def _read_landmarks(path: Path, landmark: IntArray, origin_m: FloatArray) -> _Landmarks:
    """Join points.ply, about an origin (3,), with the (T,) rows of its points that tracks.csv names."""
    points = read_points(path)
    track = np.flatnonzero(landmark >= 0)
    row = landmark[track]
    if len(row) != len(points.xyz_m) or not np.array_equal(np.sort(row), np.arange(len(row))):
        raise AsfmError(f"{path}: expected the points of the tracks in {TRACKS}, found others; run asfm run again")
    return _Landmarks(track, points.xyz_m[row] - origin_m, points.sigma_m[row], points.well_constrained[row])


def _starts_at_truth(sequence: Sequence, config: Config) -> bool:
    """Return whether odometry, and so the run, is in the world of the true poses, decided by the first pose."""
    if sequence.odometry is None or sequence.groundtruth is None or not config.backend.use_odometry:
        return False
    at_start = sequence.timestamps_s[:1]
    start, truth = (
        interpolate(trajectory.timestamps_s, trajectory.world_from_vehicle, at_start)[0]
        for trajectory in (sequence.odometry, sequence.groundtruth)
    )
    apart = pose_log((invert(truth) @ start)[None])[0]
    return bool(np.linalg.norm(apart[:3]) < SAME_WORLD_RAD and np.linalg.norm(apart[3:]) < SAME_WORLD_M)
