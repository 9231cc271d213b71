"""``asfm view``: opens the recording of a results folder or a recording file, and reports the viewer's exit code."""

from collections.abc import Callable
from pathlib import Path

import pytest

from asfm.cli import run_command_line

OPEN_VIEWER = "asfm.visualization.viewer.open_viewer"


def test_view_opens_the_recording(tmp_path: Path, ask: Callable[..., str], monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Path] = []

    def open_viewer(path: Path) -> int:
        opened.append(path)
        return 0

    monkeypatch.setattr(OPEN_VIEWER, open_viewer)
    recording = tmp_path / "reconstruction.rrd"
    recording.touch()
    ask("view", tmp_path)
    ask("view", recording)
    assert opened == [recording] * 2


def test_a_failed_viewer_and_a_missing_recording_are_errors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run_command_line(["view", str(tmp_path)]) == 2
    assert "expected a recording" in capsys.readouterr().err
    monkeypatch.setattr(OPEN_VIEWER, lambda path: 3)
    assert run_command_line(["view", str(tmp_path)]) == 2
    assert "ended with code 3" in capsys.readouterr().err
