"""``asfm run``: a sequence goes in, a folder of results comes out."""

import time
from contextlib import closing
from pathlib import Path

from asfm.atomic_folder import atomic_folder
from asfm.config import Config
from asfm.config_file import dump_config
from asfm.datasets import open_sequence
from asfm.datasets.hloc.features_matches import read_hloc
from asfm.datasets.hloc.image_names import name_images
from asfm.datasets.tables import read_tum
from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError
from asfm.evaluation.pose_error_table import EvaluationTable, evaluate_sequence
from asfm.recorder import NullRecorder, Recorder
from asfm.results.report import RunSummary, describe_run
from asfm.results.writers import RESULTS, write_points, write_pose_sigmas, write_report, write_tracks, write_trajectory
from asfm.sequence import Sequence
from asfm.stages import Progress, no_progress
from asfm.types import Trajectory


def run_sequence(
    path: Path,
    output: Path,
    config: Config | None = None,
    recording: bool = True,
    overwrite: bool = False,
    progress: Progress = no_progress,
    correspondences: tuple[Path, Path] | None = None,
) -> RunSummary:
    """Reconstruct a sequence and write all results; the output folder appears only when it is whole.

    Args:
        path: folder or file of any format that is read.
        output: gets trajectory.tum, points.ply, tracks.csv, report.json, config.yaml, reconstruction.rrd if it is to be
            recorded, and evaluation.json if the sequence knows its true poses or hand-tracked points.
        config: every setting; the defaults without one.
        recording: make reconstruction.rrd for the viewer.
        overwrite: replace results that are there.
        progress: told how far each stage is.
        correspondences: features.h5 and matches.h5 of hloc, which take the place of asfm's own front-end.

    Raises:
        AsfmError: the sequence or the correspondences cannot be read, or the output folder cannot be written.
    """
    from asfm.pipeline.reconstruction import reconstruct  # loads GTSAM

    begin_s = time.perf_counter()
    config = config or Config()
    sequence = open_sequence(path)
    given = None if correspondences is None else read_hloc(*correspondences, sequence, name_images(path, sequence))
    with atomic_folder(output, RESULTS, overwrite) as folder:
        with closing(_make_recorder(folder / "reconstruction.rrd", sequence, recording)) as recorder:
            run = reconstruct(sequence, config, recorder, progress, given)
        result = run.reconstruction
        write_trajectory(folder / "trajectory.tum", result.trajectory)
        evaluation, remarks = _evaluate(sequence, read_tum(folder / "trajectory.tum"))  # as asfm evaluate will read it
        write_points(folder / "points.ply", result.landmarks)
        write_pose_sigmas(folder / "pose_sigmas.csv", result.trajectory.timestamps_s, result.pose_covariance)
        write_tracks(folder / "tracks.csv", result.tracks, result.observed)
        (folder / "config.yaml").write_text(dump_config(config), encoding="utf-8")
        if evaluation is not None:
            write_report(folder / "evaluation.json", evaluation.as_dict())
        diagnostics = tuple(dict.fromkeys((*sequence.diagnostics, *result.diagnostics, *remarks)))
        wall_s = time.perf_counter() - begin_s
        summary = RunSummary(output, path, sequence, result, run.stages, diagnostics, evaluation, wall_s)
        write_report(folder / "report.json", describe_run(summary, config))
    return summary


def _make_recorder(path: Path, sequence: Sequence, recording: bool) -> Recorder:
    if not recording:
        return NullRecorder()
    from asfm.visualization.rerun_recorder import RerunRecorder

    return RerunRecorder(path, sequence)


def _evaluate(sequence: Sequence, estimate: Trajectory) -> tuple[EvaluationTable | None, tuple[Diagnostic, ...]]:
    """Compare with what the sequence knows, or say why that cannot be: no reason to throw the results away."""
    if sequence.groundtruth is None and sequence.hand_tracks is None:
        return None, ()
    try:
        return evaluate_sequence(sequence, estimate), ()
    except AsfmError as error:
        return None, (Diagnostic("not-evaluated", f"not evaluated: {error}"),)
