"""Summary tables: means by matcher, filters, back-end and mode, as text, CSV, Markdown and LaTeX."""

import csv
import io

import pytest

from asfm.study.report.summary_table import (
    escape_latex,
    format_summary,
    note_unequal_cells,
    summarise_rows,
    to_csv,
    to_latex,
    to_markdown,
)
from tests.study.report.rows import make_row

ROWS = [
    make_row(ate_m=0.1, ate_over_bound=1.0, precision=0.8, matches=10, sequence="one"),
    make_row(ate_m=0.4, ate_over_bound=4.0, precision=0.9, matches=30, sequence="two"),
    make_row(error="failed", filters="a_b & c"),
    make_row(detector="true matches", wrong_share=0.0, ate_m=9.0),
]


def test_errors_are_averaged_geometrically_and_the_rest_arithmetically() -> None:
    first, second = summarise_rows(ROWS)
    assert (first.cells, first.failed, second.cells, second.failed) == (2, 0, 1, 1)
    assert first.ate_m == pytest.approx(0.2) and first.ate_over_bound == pytest.approx(2.0)
    assert first.precision == pytest.approx(0.85) and first.matches == 20
    assert second.ate_m is None and first.recall is None


def test_tables_leave_out_what_nobody_has() -> None:
    headings, cells = format_summary(summarise_rows(ROWS))
    assert headings == [
        *("matcher", "filters", "mode", "cells", "failed", "with ATE", "matches", "precision"),
        *("ATE (m)", "ATE / bound", "time (s)"),
    ]
    assert cells[0] == ["akaze", "all", "all", "2", "0", "2", "20", "0.850", "0.2000", "2.00", "1.0"]
    assert cells[1][:6] == ["akaze", "a_b & c", "all", "1", "1", "0"] and cells[1][8] == ""
    assert "with ATE" not in format_summary(summarise_rows(ROWS[:2]))[0], "every cell has one"
    several, _ = format_summary(summarise_rows([*ROWS, make_row(backend="other")]))
    assert "back-end" in several and "failed" not in format_summary(summarise_rows(ROWS[:2]))[0]


def test_means_over_different_cells_are_named() -> None:
    same = [make_row(detector=name, sequence=where, ate_m=0.1) for name in ("akaze", "orb") for where in ("a", "b")]
    assert note_unequal_cells(same) == ""
    assert "not all over the same sequences and seeds" in note_unequal_cells(same[:3])
    assert note_unequal_cells([*same[:3], make_row(detector="orb", sequence="b", error="failed")])
    assert note_unequal_cells([*same, make_row(mode="sonar", sequence="a", ate_m=0.1)]) == "", "modes are apart"
    assert note_unequal_cells([*same, make_row(sequence="c", wrong_share=0.0, ate_m=0.1)]) == ""


def test_every_format_holds_every_cell() -> None:
    headings, cells = format_summary(summarise_rows(ROWS))
    assert list(csv.reader(io.StringIO(to_csv(headings, cells)))) == [headings, *cells]
    lines = to_markdown(headings, [*cells, ["a|b"] * len(headings)]).splitlines()
    assert len(lines) == 5 and all(line.replace("\\|", "").count("|") == len(headings) + 1 for line in lines)
    latex = to_latex(headings, cells)
    assert latex.count("\\\\\n") == 3 and latex.count(" & ") == 3 * (len(headings) - 1)
    assert "a\\_b \\& c" in latex and latex.startswith("\\begin{tabular}{" + "l" * len(headings))
    assert "&lt;b&gt; a" in to_markdown(["x"], [["<b>\na"]]) and escape_latex("<|>") == (
        r"\textless{}\textbar{}\textgreater{}"
    )
    assert escape_latex("50 % {x}^~\\") == r"50 \% \{x\}\textasciicircum{}\textasciitilde{}\textbackslash{}"
