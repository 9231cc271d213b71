"""Output of ``asfm compare``: the table as CSV and text, and the plot of precision against ATE."""

import csv
from pathlib import Path

from asfm.atomic_folder import FolderKind
from asfm.commands.text import align
from asfm.errors import escape
from asfm.evaluation.precision_plot import NO_MATPLOTLIB, draw_precision, plottable
from asfm.evaluation.run_comparison import ComparedRun, RunComparison
from asfm.results.output_file import write_file

TABLE, PLOT_SVG, PLOT_PNG = "comparison.csv", "precision_ate.svg", "precision_ate.png"
COMPARISON = FolderKind("a comparison", marks=(TABLE,), patterns=(TABLE, PLOT_SVG, PLOT_PNG))
COLUMNS = (
    *("run", "sequence", "matcher", "precision", "recall", "arc_inlier_ratio", "matches", "ate_m", "mirror_ambiguous"),
    *("ate_over_odometry", "ate_over_bound", "nees_position", "nees_attitude", "seconds"),
)
HEADER = (
    *("run", "sequence", "matcher", "precision", "recall", "arc share", "matches"),
    *("ATE m", "/ odometry", "/ bound", "NEES pos.", "NEES att.", "s"),
)
MISSING = "-"


def write_comparison(folder: Path, comparison: RunComparison) -> tuple[str, ...]:
    """Write comparison.csv, and precision_ate.svg and .png where there is something to plot.

    Returns:
        Notes on what could not be written.

    Raises:
        AsfmError: a file cannot be written.
    """
    with (folder / TABLE).open("w", encoding="utf-8", errors="backslashreplace", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows([_list_values(run) for run in comparison.runs])
    runs = plottable(comparison.runs)
    if not runs:
        return ("No plot: no run has both an ATE and a precision or arc share.",)
    try:
        pictures = draw_precision(runs)
    except ImportError:
        return (f"No plot: {NO_MATPLOTLIB}.",)
    write_file(folder / PLOT_SVG, pictures["svg"])
    write_file(folder / PLOT_PNG, pictures["png"])
    left_out = [run.labels.run for run in comparison.runs if run not in runs]
    return (f"Not in the plot, for want of ATE or matches with truth: {', '.join(left_out)}.",) if left_out else ()


def describe_comparison(comparison: RunComparison) -> list[str]:
    """Format the runs side by side, and the notes; missing values are dashes."""
    rows = [HEADER, *(_format_row(run) for run in comparison.runs)]
    lines = align(rows, numbers=range(3, len(HEADER)))
    return [*lines, "ATE: RMSE, SE(3)-aligned, scale off"] + [f"note: {escape(note)}" for note in comparison.notes]


def _list_values(run: ComparedRun) -> list[object]:
    """Return the cells of one row of comparison.csv; what is unknown is empty."""
    named = vars(run) | vars(run.labels) | {"mirror_ambiguous": int(run.mirror_ambiguous)}
    return ["" if named[name] is None else named[name] for name in COLUMNS]


def _format_row(run: ComparedRun) -> tuple[str, ...]:
    ate = _show(run.ate_m, 4) + ("*" if run.mirror_ambiguous and run.ate_m is not None else "")
    names = (escape(name) for name in (run.labels.run, run.labels.sequence, run.labels.matcher))
    shares = (_show(value, 3) for value in (run.precision, run.recall, run.arc_inlier_ratio))
    ratios = (
        _show(value, 2) for value in (run.ate_over_odometry, run.ate_over_bound, run.nees_position, run.nees_attitude)
    )
    return (*names, *shares, _show(run.matches, 0), ate, *ratios, _show(run.seconds, 1))


def _show(value: float | None, digits: int) -> str:
    return MISSING if value is None else f"{value:.{digits}f}"
