"""Command ``asfm run``: reconstruct a sequence and write a results folder."""

import time
from contextlib import closing
from pathlib import Path

from asfm.atomic_folder import atomic_folder
from asfm.config import Config
from asfm.config_file import dump_config
from asfm.datasets import open_sequence
from asfm.datasets.hloc.features_matches import read_hloc, write_hloc
from asfm.datasets.hloc.image_names import ImageNames, name_images
from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError
from asfm.evaluation.evaluation_table import EvaluationTable
from asfm.evaluation.mirror_image import MIRROR_AMBIGUITY, add_mirror_image
from asfm.evaluation.pose_error_table import evaluate_sequence
from asfm.frame_selection import choose_frames, take_frames, take_matches
from asfm.recorder import NullRecorder, Recorder
from asfm.results.evaluation_json import write_evaluation
from asfm.results.points_ply import write_points
from asfm.results.pose_covariances_csv import write_pose_covariances
from asfm.results.pose_sigmas_csv import write_pose_sigmas
from asfm.results.report_json import write_report
from asfm.results.results_folder import (
    CONFIG,
    FEATURES,
    MATCHES,
    POINTS,
    POSE_COVARIANCES,
    POSE_SIGMAS,
    RECORDING,
    REPORT,
    RESULTS,
    TRACKS,
    TRAJECTORY,
)
from asfm.results.run_summary import RunSummary
from asfm.results.tracks_csv import write_tracks
from asfm.results.trajectory_tum import read_trajectory, write_trajectory
from asfm.sequence import Sequence
from asfm.stages import Progress, no_progress
from asfm.types import ExternalMatches, IntArray, Reconstruction


def run_sequence(
    path: Path,
    output: Path,
    config: Config | None = None,
    recording: bool = True,
    overwrite: bool = False,
    progress: Progress = no_progress,
    external_matches: tuple[Path, Path] | None = None,
) -> RunSummary:
    """Reconstruct a sequence and write the results folder, which appears only when it is complete.

    Args:
        path: folder or file of the sequence, in any supported format.
        output: the results folder; :mod:`asfm.results.results_folder` lists its files.
        config: all settings; the defaults where it is None.
        recording: write a recording for the Rerun viewer.
        overwrite: replace existing results.
        progress: receives the progress of each stage.
        external_matches: features.h5 and matches.h5 of hloc, which replace the keypoints and matches of asfm.

    Raises:
        AsfmError: the sequence or the matches cannot be read, or the results folder cannot be written.
    """
    begin_s = time.perf_counter()
    config = config or Config()
    whole = open_sequence(path)
    chosen = choose_frames(whole, config.frames)
    if len(chosen) == len(whole):
        whole.check_frames()
    names = name_images(path, whole)
    given = external_matches and _read_matches(*external_matches, whole, names, chosen)
    sequence, names = take_frames(whole, chosen), names.take(chosen)
    from asfm.pipeline.reconstruction import reconstruct  # loads GTSAM; a refused input need not wait for it

    with atomic_folder(output, RESULTS, overwrite) as folder:
        with closing(_make_recorder(folder / RECORDING, sequence, recording)) as recorder:
            run = reconstruct(sequence, config, recorder, progress, given)
        result = run.reconstruction
        _write_reconstruction(folder, result, config)
        write_hloc(folder / FEATURES, folder / MATCHES, names, run.keypoints, run.matches)
        evaluation, remarks = _evaluate(folder, sequence, result)
        diagnostics = tuple(dict.fromkeys((*sequence.diagnostics, *result.diagnostics, *remarks)))
        wall_s = time.perf_counter() - begin_s
        summary = RunSummary(
            output, path, sequence, result, run.stages, diagnostics, evaluation, wall_s, external_matches, run.noise
        )
        write_report(folder / REPORT, summary, config)
    return summary


def _read_matches(
    features: Path, matches: Path, whole: Sequence, names: ImageNames, chosen: IntArray
) -> ExternalMatches:
    """Read the matches of the chosen frames, from files of the whole recording or of these frames alone."""
    try:
        return take_matches(read_hloc(features, matches, whole, names), chosen)
    except AsfmError as error:
        if len(chosen) == len(whole):
            raise
        try:
            return read_hloc(features, matches, whole, names.take(chosen))
        except AsfmError:
            raise error from None


def _make_recorder(path: Path, sequence: Sequence, recording: bool) -> Recorder:
    if not recording:
        return NullRecorder()
    from asfm.visualization.rerun_recorder import RerunRecorder

    return RerunRecorder(path, sequence)


def _write_reconstruction(folder: Path, result: Reconstruction, config: Config) -> None:
    write_trajectory(folder / TRAJECTORY, result.trajectory)
    write_points(folder / POINTS, result.landmarks)
    write_pose_sigmas(folder / POSE_SIGMAS, result.trajectory.timestamps_s, result.pose_covariance)
    write_pose_covariances(folder / POSE_COVARIANCES, result.trajectory.timestamps_s, result.pose_covariance)
    write_tracks(folder / TRACKS, result.tracks, result.observed, result.landmarks.track)
    (folder / CONFIG).write_text(dump_config(config), encoding="utf-8")


def _evaluate(
    folder: Path, sequence: Sequence, result: Reconstruction
) -> tuple[EvaluationTable | None, tuple[Diagnostic, ...]]:
    """Compare with the ground truth of the sequence; a failure becomes a diagnostic, so that the results are kept."""
    if sequence.groundtruth is None and sequence.hand_tracks is None:
        return None, ()
    try:
        estimate = read_trajectory(folder / TRAJECTORY)  # rounded as in the file, so that asfm evaluate finds the same
        evaluation = evaluate_sequence(sequence, estimate)
        if any(found.code == MIRROR_AMBIGUITY for found in result.diagnostics):
            evaluation = add_mirror_image(evaluation, sequence, estimate)
    except AsfmError as error:
        return None, (Diagnostic("not-evaluated", f"not evaluated: {error}"),)
    write_evaluation(folder, evaluation)
    return evaluation, ()
