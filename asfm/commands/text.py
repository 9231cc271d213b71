"""Results of the commands formatted as lines of text for a terminal."""

from collections.abc import Iterable, Sequence

from asfm.evaluation.evaluation_table import EvaluationTable
from asfm.results.results_folder import EVALUATION, RECORDING
from asfm.results.run_summary import RunSummary


def align(rows: Iterable[Sequence[str]], numbers: Sequence[int] = ()) -> list[str]:
    """Pad the cells of a table to columns.

    Args:
        rows: cells, the same number in each row.
        numbers: indices of the columns that are aligned to the right.

    Returns:
        One line per row, never truncated to the width of the terminal.
    """
    rows = list(rows)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = enumerate(zip(row, widths, strict=True))
        lines.append("  ".join(cell.rjust(width) if n in numbers else cell.ljust(width) for n, (cell, width) in cells))
    return [line.rstrip() for line in lines]


def describe_results(summary: RunSummary) -> list[str]:
    """Format the cost and counts of each stage, the pose errors, and the path of the results."""
    rows = [("stage", "s", "peak MB", "counts")]
    for stage in summary.stages:
        counts = ", ".join(f"{count:,g} {name}" for name, count in stage.counts.items())
        rows.append((stage.name, f"{stage.wall_s:.2f}", f"{stage.peak_memory_mb:.0f}", counts))
    lines = align(rows, numbers=(1, 2))
    lines.append(f"{len(summary.sequence)} frames of {summary.sequence.name} in {summary.wall_s:.1f} s")
    for row in summary.evaluation.rows if summary.evaluation is not None else ():
        if row.key.startswith("ate_rmse_m_"):
            odometry = "" if row.odometry is None else f"; odometry {row.odometry:.4f} {row.unit}"
            ratio = "" if row.ratio is None else f", ratio {row.ratio:.2f}"
            lines.append(f"{row.name}: {row.value:.4f} {row.unit}{odometry}{ratio}")
    lines.append(f"results: {summary.folder}")
    if (summary.folder / RECORDING).is_file():
        lines.append(f"view them with: asfm view {summary.folder}")
    return lines


def describe_errors(table: EvaluationTable) -> list[str]:
    """Format every measure of a run next to that of the odometry, and the notes on the comparison."""
    rows = [("measure", "run", "unit", "odometry", "ratio")]
    for row in table.rows:
        if row.detail:
            continue
        digits = 0 if row.unit in ("poses", "matches", "tracks") else 4
        rows.append(
            (row.name, _show(row.value, digits), row.unit, _show(row.odometry, digits), _show(row.ratio, digits=2))
        )
    lines, details = align(rows, numbers=(1, 3, 4)), sum(row.detail for row in table.rows)
    if details:
        lines.append(f"{details} more measures, by gap, view change and threshold: {EVALUATION}")
    return lines + [f"note: {note}" for note in table.notes]


def _show(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"
