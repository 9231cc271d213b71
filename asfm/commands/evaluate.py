"""``asfm evaluate``: the quality of a folder of results."""

from pathlib import Path

from asfm.config_file import load_config
from asfm.datasets import open_sequence, open_truth
from asfm.datasets.tables import read_tum
from asfm.errors import AsfmError
from asfm.evaluation.accuracy_bound import add_bound, measure_bound
from asfm.evaluation.pose_error_table import EvaluationTable, evaluate_sequence, evaluate_trajectory
from asfm.results.report import read_report
from asfm.results.tracks_csv import read_tracks
from asfm.results.writers import write_report
from asfm.sequence import Sequence
from asfm.types import Trajectory


def evaluate_folder(folder: Path, reference: Path | None = None) -> EvaluationTable:
    """Compare a run's trajectory with the truth, and with what ideal features would reach in a simulated sequence.

    Writes evaluation.json beside it.

    Args:
        folder: what asfm run wrote; its report names the sequence, which knows true poses and odometry.
        reference: a TUM file of true world_from_vehicle poses that stands in for the sequence's own; then no bound
            is measured.

    Raises:
        AsfmError: the folder, the sequence or the reference cannot be read, there is nothing to compare with, or
            evaluation.json cannot be written.
    """
    source = Path(read_report(folder)["sequence"]["path"])
    estimate = read_tum(folder / "trajectory.tum")
    truth = read_tum(reference) if reference is not None else None
    table = _compare(folder, source, estimate, truth)
    _replace_report(folder / "evaluation.json", table)
    return table


def _compare(folder: Path, source: Path, estimate: Trajectory, truth: Trajectory | None) -> EvaluationTable:
    """Use all that the sequence knows; where it has gone, a reference is enough."""
    try:
        sequence = open_sequence(source)
    except AsfmError as error:
        if truth is None:
            raise AsfmError(f"{error}; or give a reference trajectory (--reference)") from None
        table = evaluate_trajectory(truth, None, estimate)
        return EvaluationTable(table.rows, (*table.notes, f"Without the odometry's row: {error}."))
    table = evaluate_sequence(sequence, estimate, truth)
    return table if truth is not None else _bound(folder, source, sequence, table)


def _bound(folder: Path, source: Path, sequence: Sequence, table: EvaluationTable) -> EvaluationTable:
    """Add the bound where the sequence is simulated, or say what is missing for it."""
    read_truth = open_truth(source)
    if read_truth is None or sequence.groundtruth is None:
        return table
    path = folder / "tracks.csv"
    if not path.exists():
        note = "No bound: the results hold no tracks.csv, which asfm run has not always written; run it again."
        return EvaluationTable(table.rows, (*table.notes, note))
    tracks, observed = read_tracks(path, len(sequence))
    bound = measure_bound(sequence, read_truth, tracks, observed, load_config(folder / "config.yaml"))
    return add_bound(table, bound)


def _replace_report(path: Path, table: EvaluationTable) -> None:
    partial = path.with_name(f".{path.name}.partial")
    try:
        write_report(partial, table.as_dict())
        partial.replace(path)
    except OSError as error:
        raise AsfmError(f"{path}: cannot write: {error.strerror}") from None
    finally:
        partial.unlink(missing_ok=True)
