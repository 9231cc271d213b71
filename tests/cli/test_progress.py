"""Progress: bars on a terminal, lines elsewhere."""

from pathlib import Path
from typing import Any

import pytest

from asfm.cli import run_command_line
from asfm.cli.progress import format_duration, show_countdown


def test_progress_is_one_line_per_stage_without_a_terminal(sequence_folder: Path, tmp_path: Path, capsys: Any) -> None:
    assert run_command_line(["convert", str(sequence_folder), str(tmp_path / "two")]) == 0
    assert capsys.readouterr().err == "convert: 3 steps\n"


def test_progress_is_a_bar_on_a_terminal(
    sequence_folder: Path, tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    assert run_command_line(["convert", str(sequence_folder), str(tmp_path / "out")]) == 0
    assert "3/3" in capsys.readouterr().err


def test_a_countdown_prints_few_lines_away_from_a_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = iter([100.0, 100.0, 101.0, 140.0, 140.0, 141.0, 142.0])
    monkeypatch.setattr("asfm.cli.progress.time.monotonic", lambda: next(now_s))
    with show_countdown("study") as report:
        for done, left_s in ((1, 7200.0), (2, 100.0), (3, 80.0), (4, 0.0)):
            report(done, 4, left_s)
    lines = capsys.readouterr().err.splitlines()
    left = ("1 of 4 cells, 2.0 h", "3 of 4 cells, 80 s", "4 of 4 cells, 0 s")
    assert lines == [f"study: {text} left" for text in left]
    assert format_duration(100) == "2 min"
