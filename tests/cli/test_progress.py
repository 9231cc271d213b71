"""Progress: bars on a terminal, lines elsewhere."""

from pathlib import Path
from typing import Any

import pytest

from asfm.cli import run_command_line


def test_progress_is_one_line_per_stage_without_a_terminal(sequence_folder: Path, tmp_path: Path, capsys: Any) -> None:
    assert run_command_line(["convert", str(sequence_folder), str(tmp_path / "two")]) == 0
    assert capsys.readouterr().err == "convert: 3 steps\n"


def test_progress_is_a_bar_on_a_terminal(
    sequence_folder: Path, tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    assert run_command_line(["convert", str(sequence_folder), str(tmp_path / "out")]) == 0
    assert "3/3" in capsys.readouterr().err
