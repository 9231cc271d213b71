"""Output of ``asfm compare``: dashes, stars, the CSV, and a missing Matplotlib."""

import csv
from dataclasses import replace
from pathlib import Path

import pytest

from asfm.commands import compare_files
from asfm.commands.compare_files import COLUMNS, describe_comparison, write_comparison
from asfm.evaluation.run_comparison import ComparedRun, RunComparison, RunLabels

FULL = ComparedRun(
    RunLabels("full", "reef", "akaze, mutual"), 8.9, 0.9774, 0.431, 0.92, 11494, 0.0206, False, 0.26, 1.62, 0.92, 0.76
)
EMPTY = ComparedRun(RunLabels("emp\x1bty", "reef", "orb, ratio"), None)


def test_missing_values_are_dashes_and_control_characters_are_escaped() -> None:
    header, full, empty, about, note = describe_comparison(RunComparison((FULL, EMPTY), ("odd",)))
    assert header.split()[:3] == ["run", "sequence", "matcher"] and header.endswith(" s")
    assert full.split()[4:] == ["0.977", "0.431", "0.920", "11494", "0.0206", "0.26", "1.62", "0.92", "0.76", "8.9"]
    assert empty.split() == ["emp\\x1bty", "reef", "orb,", "ratio", *["-"] * 10]
    assert "SE(3)-aligned, scale off" in about and note == "note: odd"


def test_an_ambiguous_run_has_a_star() -> None:
    _, row, _ = describe_comparison(RunComparison((replace(FULL, mirror_ambiguous=True),)))
    assert " 0.0206* " in row


def test_csv_reads_back_and_unknown_cells_are_empty(tmp_path: Path) -> None:
    assert write_comparison(tmp_path, RunComparison((FULL, EMPTY))) == (
        "Not in the plot, for want of ATE or matches with truth: emp\x1bty.",
    )
    with (tmp_path / "comparison.csv").open(encoding="utf-8", newline="") as file:
        full, empty = csv.DictReader(file)
    assert tuple(full) == COLUMNS
    assert float(full["precision"]) == 0.9774 and full["matches"] == "11494" and full["mirror_ambiguous"] == "0"
    assert full["matcher"] == "akaze, mutual" and empty["ate_m"] == empty["seconds"] == ""
    assert {path.name for path in tmp_path.iterdir()} == {"comparison.csv", "precision_ate.svg", "precision_ate.png"}


def test_nothing_to_plot_is_said(tmp_path: Path) -> None:
    (note,) = write_comparison(tmp_path, RunComparison((EMPTY,)))
    assert "No plot: no run has both" in note
    assert [path.name for path in tmp_path.iterdir()] == ["comparison.csv"]


def test_without_matplotlib_the_table_is_written_and_a_line_says_how_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(runs: object) -> dict[str, bytes]:
        raise ImportError("No module named 'matplotlib'")

    monkeypatch.setattr(compare_files, "draw_precision", refuse)
    (note,) = write_comparison(tmp_path, RunComparison((FULL,)))
    assert "pip install matplotlib" in note and "\n" not in note
    assert [path.name for path in tmp_path.iterdir()] == ["comparison.csv"]
