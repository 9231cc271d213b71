"""Command ``asfm study``: a grid of reconstructions, its tables and its report."""

from dataclasses import dataclass
from pathlib import Path

from asfm.datasets import open_sequence
from asfm.errors import AsfmError
from asfm.study.cell import Cell, Recording
from asfm.study.report.error_law import ErrorLaw, fit_law
from asfm.study.report.html_report import require_matplotlib, write_report
from asfm.study.report.summary_table import SummaryRow, summarise_rows
from asfm.study.results_table import Row
from asfm.study.sequence_provider import check_sensors
from asfm.study.study_definition import StudyDefinition
from asfm.study.study_run import RunSettings, compute_cells, load_grid, no_report
from asfm.study.task_queue import Report
from asfm.study.time_estimate import Estimate, estimate_time


@dataclass(frozen=True)
class StudyPlan:
    """What a study would do."""

    study: StudyDefinition
    estimate: Estimate
    functions: tuple[str, ...]
    """Entry points of external matchers, code that would be run."""
    failing: tuple[str, ...] = ()
    """Why cells would fail: recordings without the sensors of a mode."""


@dataclass(frozen=True)
class StudySummary:
    """A finished study."""

    folder: Path
    rows: list[Row]
    computed: int
    """Cells that were computed now; the others were finished before."""
    summary: list[SummaryRow]
    """Means over sequences and seeds."""
    law: ErrorLaw | None
    """None where there is too little to fit it to."""


def plan_study(path: Path) -> StudyPlan:
    """List what a study would do, and estimate its time.

    Raises:
        AsfmError: the file, a path or a setting is at fault, or the grid is empty.
    """
    study, cells = load_grid(path)
    functions = tuple(matcher.function for matcher in study.external if matcher.function is not None)
    return StudyPlan(study, estimate_time(cells), functions, _list_missing_sensors(study, cells))


def _list_missing_sensors(study: StudyDefinition, cells: list[Cell]) -> tuple[str, ...]:
    """Return a line for each recording and mode whose sensors the recording lacks."""
    found = []
    for recording in dict.fromkeys(cell.sequence for cell in cells if isinstance(cell.sequence, Recording)):
        sequence = open_sequence(recording.path)
        for mode in study.modes:
            try:
                check_sensors(sequence, mode)
            except AsfmError as error:
                found.append(str(error))
    return tuple(found)


def require_success(summary: StudySummary) -> None:
    """Check that not all cells of a study failed.

    Raises:
        AsfmError: they did; the message has the error of the first one.
    """
    errors = [row["error"] for row in summary.rows]
    if all(errors):
        raise AsfmError(f"all {len(errors)} cells of the study failed, the first one with: {errors[0]}")


def run_study(
    path: Path,
    output: Path | None,
    settings: RunSettings | None = None,
    report: Report = no_report,
) -> StudySummary:
    """Run a study: every cell that is not finished, then tables, figures and the report.

    Args:
        path: the study file.
        output: folder of the study; finished cells of the same study in it are kept.
        settings: where the cells are run, and whether those that have failed are run again.
        report: receives (cells done, cells to do, seconds left).

    Raises:
        AsfmError: the file, a path or a setting is at fault, the folder holds something else, another process works in
            it, a file cannot be written, a cluster cannot be had, or matplotlib is missing.
    """
    if output is None:
        raise AsfmError("expected a folder for the study (--output DIR), or --dry-run, found neither")
    require_matplotlib()
    settings = settings or RunSettings()
    settings.choose_engine()  # its faults are found before the grid is built
    study, cells = load_grid(path)

    def finish(folder: Path, rows: list[Row]) -> None:
        write_report(folder, rows)

    results = compute_cells(study, cells, output, settings, report, finish=finish)
    return StudySummary(output, results.rows, results.computed, summarise_rows(results.rows), fit_law(results.rows))
