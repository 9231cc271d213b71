"""Summary of a study: means over sequences and seeds of each matcher, filter chain, back-end and mode."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from html import escape

import numpy as np

from asfm.study.results_table import Row

GROUP = ("detector", "filters", "backend", "mode")
DIALS = (
    "wrong_share",
    "wrong_kind",
    "stated_range_noise_bins",
    "stated_bearing_noise_beams",
    "noise_kind",
    "stated_recall",
    "stated_track_length",
)
Cells = list[list[str]]


@dataclass(frozen=True)
class SummaryRow:
    """Means of the cells of one matcher, filter chain, back-end and mode; None where nothing was measured."""

    detector: str
    filters: str
    backend: str
    mode: str
    cells: int
    failed: int
    measured: int
    """Cells with an ATE, over which its means are taken."""
    matches: float | None
    precision: float | None
    recall: float | None
    arc_inlier_ratio: float | None
    ate_m: float | None
    """Geometric mean."""
    ate_over_odometry: float | None
    """Geometric mean."""
    ate_over_bound: float | None
    """Geometric mean."""
    seconds: float | None


COLUMNS: dict[str, tuple[str, str]] = {
    "detector": ("matcher", ""),
    "filters": ("filters", ""),
    "backend": ("back-end", ""),
    "mode": ("mode", ""),
    "cells": ("cells", "d"),
    "failed": ("failed", "d"),
    "measured": ("with ATE", "d"),
    "matches": ("matches", ".0f"),
    "precision": ("precision", ".3f"),
    "recall": ("recall", ".3f"),
    "arc_inlier_ratio": ("arc inliers", ".3f"),
    "ate_m": ("ATE (m)", ".4f"),
    "ate_over_odometry": ("ATE / odometry", ".2f"),
    "ate_over_bound": ("ATE / bound", ".2f"),
    "seconds": ("time (s)", ".1f"),
}
"""Heading and format of each column."""


def summarise_rows(rows: Sequence[Row]) -> list[SummaryRow]:
    """Summarise the rows of real matchers, in the order of the grid; corrupted matches are in the figures."""
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        if row["wrong_share"] is None:
            groups.setdefault(tuple(row[name] for name in GROUP), []).append(row)
    return [_summarise(group, members) for group, members in groups.items()]


def note_unequal_cells(rows: Sequence[Row]) -> str:
    """Return a sentence where the means of a mode are not all over the same sequences and seeds; else nothing."""
    measured: dict[tuple[str, str], set[tuple[str, int]]] = {}
    for row in rows:
        if row["wrong_share"] is None:
            cells = measured.setdefault((row["mode"], f"{row['detector']}, {row['filters']}, {row['backend']}"), set())
            cells |= {(row["sequence"], row["seed"])} if row["ate_m"] is not None else set()
    modes = {mode for mode, _ in measured}
    if all(len({frozenset(cells) for (mode, _), cells in measured.items() if mode == own}) == 1 for own in modes):
        return ""
    return (
        "The means are not all over the same sequences and seeds, as cells failed, have no truth, or have matches of "
        "one sequence only: compare matchers where they have cells in common, in results.csv."
    )


def _summarise(group: tuple[str, ...], rows: list[Row]) -> SummaryRow:
    detector, filters, backend, mode = group
    return SummaryRow(
        detector=detector,
        filters=filters,
        backend=backend,
        mode=mode,
        cells=len(rows),
        failed=sum(row["error"] is not None for row in rows),
        measured=sum(row["ate_m"] is not None for row in rows),
        matches=mean_of(rows, "matches"),
        precision=mean_of(rows, "precision"),
        recall=mean_of(rows, "recall"),
        arc_inlier_ratio=mean_of(rows, "arc_inlier_ratio"),
        ate_m=geometric_mean_of(rows, "ate_m"),
        ate_over_odometry=geometric_mean_of(rows, "ate_over_odometry"),
        ate_over_bound=geometric_mean_of(rows, "ate_over_bound"),
        seconds=mean_of(rows, "seconds"),
    )


def mean_of(rows: Iterable[Row], name: str) -> float | None:
    """Return the mean of a column over the rows that have a value; None where none has."""
    values = [row[name] for row in rows if row[name] is not None]
    return float(np.mean(values)) if values else None


def geometric_mean_of(rows: Iterable[Row], name: str) -> float | None:
    """Return the geometric mean of a column over its positive values; None where there is none."""
    values = [row[name] for row in rows if row[name] is not None and row[name] > 0]
    return float(np.exp(np.mean(np.log(values)))) if values else None


def format_summary(summary: Sequence[SummaryRow], show: Callable[[str], str] = str) -> tuple[list[str], Cells]:
    """Format a summary as headings and cells of text; columns without any value, or a single back-end, are left out.

    Args:
        summary: the rows.
        show: converts the text of a cell, such as an escape.
    """
    names = [field.name for field in fields(SummaryRow) if any(getattr(row, field.name) is not None for row in summary)]
    names = [name for name in names if name != "failed" or any(row.failed for row in summary)]
    names = [name for name in names if name != "measured" or any(row.measured != row.cells for row in summary)]
    if len({row.backend for row in summary}) < 2:
        names = [name for name in names if name != "backend"]
    headings = [COLUMNS[name][0] for name in names]
    return headings, [[show(_format(row, name)) for name in names] for row in summary]


def _format(row: SummaryRow, name: str) -> str:
    value = getattr(row, name)
    return "" if value is None else format(value, COLUMNS[name][1])


def to_markdown(headings: Sequence[str], cells: Sequence[Sequence[str]]) -> str:
    """Format a table as Markdown."""
    plain = [[escape(" ".join(text.split()), quote=False).replace("|", "\\|") for text in row] for row in cells]
    lines = [headings, ["---"] * len(headings), *plain]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def to_csv(headings: Sequence[str], cells: Sequence[Sequence[str]]) -> str:
    """Format a table as CSV."""
    import csv
    import io

    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([headings, *cells])
    return text.getvalue()


def to_latex(headings: Sequence[str], cells: Sequence[Sequence[str]]) -> str:
    """Format a table as LaTeX with the rules of booktabs."""
    lines = [f"\\begin{{tabular}}{{{'l' * len(headings)}}}", "\\toprule"]
    rows = [" & ".join(escape_latex(text) for text in row) + " \\\\" for row in (headings, *cells)]
    return "\n".join([*lines, rows[0], "\\midrule", *rows[1:], "\\bottomrule", "\\end{tabular}", ""])


def escape_latex(text: str) -> str:
    """Escape the letters that have a meaning in LaTeX."""
    special = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    special |= {"<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}", "\n": " "}
    return "".join(special.get(letter, f"\\{letter}" if letter in "&%$#_{}" else letter) for letter in text)
