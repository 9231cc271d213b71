"""The quick variant of the standing study, as a user runs it."""

import csv
from pathlib import Path

from asfm.commands import run_study

TOOLS = Path(__file__).resolve().parents[2] / "tools"


def test_the_quick_study_ends_in_a_report(tmp_path: Path) -> None:
    reports: list[tuple[int, int]] = []
    study, output = TOOLS / "matcher_study_quick.yaml", tmp_path / "quick"
    summary = run_study(study, output, report=lambda done, total, _: reports.append((done, total)))
    assert reports[-1] == (56, 56) and summary.computed == 56
    assert [row["error"] for row in summary.rows if row["error"]] == []
    assert all(row["ate_over_bound"] > 0 and row["precision"] > 0.5 for row in summary.rows)
    assert [(row.detector, row.filters, row.mode) for row in summary.summary[:2]] == [
        ("akaze", "ratio + mutual", "sonar"),
        ("akaze", "ratio + mutual", "all"),
    ]
    ratio, full = (row.precision for row in summary.summary if row.mode == "all" and row.detector == "orb")
    assert ratio is not None and full is not None and full > ratio, "more filters, fewer wrong matches"
    assert summary.law is not None and summary.law.median_error is not None
    with (tmp_path / "quick" / "results.csv").open(newline="") as file:
        assert len(list(csv.DictReader(file))) == 56
    names = {path.name for path in (tmp_path / "quick" / "figures").iterdir()}
    assert {"precision_against_ate.svg", "dial_wrong_share.pdf", "law.svg"} <= names
    assert (tmp_path / "quick" / "report.html").stat().st_size < 1e6
