"""Text of studies: numbers to the right, failed cells named, the law in full."""

from pathlib import Path

from asfm.commands.study import StudySummary
from asfm.commands.study_text import MAX_ERRORS, describe_study
from asfm.study.report.error_law import fit_law
from asfm.study.report.summary_table import summarise_rows
from tests.study.report.rows import make_row, make_rows


def test_table_law_and_failures_are_printed() -> None:
    rows = make_rows() + [make_row(seed=seed, error="no odometry") for seed in range(MAX_ERRORS + 3)]
    law = fit_law(rows)
    assert law is not None
    lines = describe_study(StudySummary(Path("out"), rows, 7, summarise_rows(rows), law))
    assert lines[0].split()[0] == "matcher" and lines[1].split()[0] == "akaze"
    assert len({len(line) for line in lines[:5]}) == 1, "the last column is aligned to the right"
    assert [line for line in law.describe() if line not in lines] == []
    failed = [line for line in lines if line.startswith("failed: ")]
    assert len(failed) == MAX_ERRORS and failed[1] == "failed: pier-sonar, akaze, all, all, seed 1: no odometry"
    assert lines[-2:] == [f"{len(rows)} cells, 7 computed now, {MAX_ERRORS + 3} failed", "report: out/report.html"]
