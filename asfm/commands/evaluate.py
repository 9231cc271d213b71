"""Command ``asfm evaluate``: compare the results of a run with ground truth."""

from pathlib import Path

from asfm.config_file import load_config
from asfm.datasets import open_sequence, open_truth
from asfm.datasets.tables import read_tum
from asfm.errors import AsfmError
from asfm.evaluation.accuracy_bound import add_bound, measure_bound
from asfm.evaluation.pose_error_table import EvaluationTable, evaluate_sequence, evaluate_trajectory
from asfm.results.evaluation_json import write_evaluation
from asfm.results.report_json import read_report
from asfm.results.results_folder import CONFIG, TRACKS, TRAJECTORY
from asfm.results.tracks_csv import read_tracks
from asfm.results.trajectory_tum import read_trajectory
from asfm.sequence import Sequence
from asfm.types import Trajectory


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
    source = Path(read_report(folder)["sequence"]["path"])
    estimate = read_trajectory(folder / TRAJECTORY)
    truth = read_tum(reference) if reference is not None else None
    table = _compare(folder, source, estimate, truth)
    write_evaluation(folder, table)
    return table


def _compare(folder: Path, source: Path, estimate: Trajectory, truth: Trajectory | None) -> EvaluationTable:
    """Compare with all that the sequence provides; without the sequence, with the reference alone."""
    try:
        sequence = open_sequence(source)
    except AsfmError as error:
        if truth is None:
            raise AsfmError(f"{error}; or give a reference trajectory (--reference)") from None
        table = evaluate_trajectory(truth, None, estimate)
        return EvaluationTable(table.rows, (*table.notes, f"Without the odometry's row: {error}."))
    table = evaluate_sequence(sequence, estimate, truth)
    return table if truth is not None else _add_bound(folder, source, sequence, table)


def _add_bound(folder: Path, source: Path, sequence: Sequence, table: EvaluationTable) -> EvaluationTable:
    """Add the accuracy bound where the sequence is simulated, or a note on what is missing for it."""
    read_truth = open_truth(source)
    if read_truth is None or sequence.groundtruth is None:
        return table
    path = folder / TRACKS
    if not path.exists():
        note = f"No bound: the results hold no {TRACKS}, which older versions did not write; run asfm run again."
        return EvaluationTable(table.rows, (*table.notes, note))
    tracks, observed, _ = read_tracks(path, len(sequence))
    bound = measure_bound(sequence, read_truth, tracks, observed, load_config(folder / CONFIG))
    return add_bound(table, bound)
