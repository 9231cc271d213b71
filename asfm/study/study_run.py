"""Run of a study: all cells that are not finished yet, then the tables and the report."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from asfm.errors import AsfmError
from asfm.folder_lock import lock_folder
from asfm.study.cell import Cell
from asfm.study.cell_run import CELLS, CellTask, run_cell
from asfm.study.engines import Engine, choose_engine
from asfm.study.grid import build_grid
from asfm.study.manifest import make_folder, make_manifest, open_study_folder
from asfm.study.match_pictures import choose_illustrated
from asfm.study.results_table import Row, read_rows, write_results
from asfm.study.shared_matching import list_requests
from asfm.study.study_definition import StudyDefinition, read_study
from asfm.study.task_queue import Report, RunTask


@dataclass(frozen=True)
class RunSettings:
    """How the cells of a study are run."""

    jobs: int | None = None
    """Number of processes of this machine; that of its cores where nothing else is said."""
    retry_failed: bool = False
    """Run cells again whose row is an error."""
    scheduler: str | None = None
    """Address of the Dask scheduler whose workers run the cells."""
    cluster: Path | None = None
    """File of the Dask cluster that is started to run the cells."""

    def choose_engine(self) -> Engine:
        """Return what runs the cells; nothing is started yet.

        Raises:
            AsfmError: the settings contradict each other, are wrong, or need what is not installed.
        """
        return choose_engine(self.jobs, self.scheduler, self.cluster)


@dataclass(frozen=True)
class StudyResults:
    """A finished study."""

    folder: Path
    rows: list[Row]
    """One a cell, in the order of the grid."""
    computed: int
    """Cells that this run computed; the others were finished before."""


def no_report(done: int, total: int, seconds_left: float) -> None:
    """Ignore the progress."""


def load_grid(path: Path) -> tuple[StudyDefinition, list[Cell]]:
    """Read a study file and list its cells.

    Raises:
        AsfmError: the file, a path or a setting is at fault, or the grid is empty.
    """
    study = read_study(path)
    return study, build_grid(study, path.resolve().parent)


def compute_cells(
    study: StudyDefinition,
    cells: Sequence[Cell],
    folder: Path,
    settings: RunSettings | None = None,
    report: Report = no_report,
    run: RunTask = run_cell,
    finish: Callable[[Path, list[Row]], None] | None = None,
) -> StudyResults:
    """Compute the cells that are not finished, and write results.parquet and results.csv.

    Args:
        study: the definition.
        cells: its grid.
        folder: of the study; it may hold finished cells of the same study.
        settings: where cells are computed, and whether failed ones are computed again.
        report: receives the progress.
        run: runs one cell.
        finish: writes the report, while the folder is still locked.

    Raises:
        AsfmError: the folder holds something else, another process works in it, a file cannot be written, or the engine
            cannot be had.
    """
    cells, settings = list(cells), settings or RunSettings()
    engine = settings.choose_engine()
    make_folder(folder)
    with lock_folder(folder) as locked:
        if not locked and sys.platform != "win32":
            raise AsfmError(f"{folder}: another asfm study is at work in this folder: wait for it or stop it")
        open_study_folder(folder, make_manifest(study, cells))
        pending = _find_pending(folder / CELLS, cells, settings.retry_failed)
        requests = list_requests(cells)
        illustrated = choose_illustrated(cells)
        tasks = [CellTask(cell, requests.get(cell.features_key, ()), cell.id in illustrated) for cell in pending]
        if tasks:
            engine(tasks, folder, run, report)
        rows = read_rows(folder / CELLS, cells)
        write_results(folder, rows)
        if finish is not None:
            finish(folder, rows)
    return StudyResults(folder, rows, len(tasks))


def _find_pending(folder: Path, cells: list[Cell], retry_failed: bool) -> list[Cell]:
    """Return the cells that have no row; what a killed process left half-written is removed."""
    try:
        folder.mkdir(exist_ok=True)
        for partial in folder.glob(".*.partial"):
            partial.unlink()
        if retry_failed:
            for row in read_rows(folder, cells):
                if row["error"]:
                    (folder / f"{row['cell']}.parquet").unlink()
    except OSError as error:
        raise AsfmError(f"{folder}: cannot write: {error.strerror}") from None
    return [cell for cell in cells if not (folder / f"{cell.id}.parquet").is_file()]
