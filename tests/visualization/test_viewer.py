"""The Rerun viewer as a process: its options, its exit code, and missing recordings."""

import subprocess
import sys
from pathlib import Path

import pytest

from asfm.errors import AsfmError
from asfm.visualization.viewer import open_viewer


def test_viewer_opens_a_new_window_and_listens_locally_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    commands: list[list[str]] = []

    def record(command: list[str], check: bool) -> subprocess.CompletedProcess[str]:
        commands.append(command)
        return subprocess.CompletedProcess(command, 7)

    monkeypatch.setattr("asfm.visualization.viewer.subprocess.run", record)
    (tmp_path / "x.rrd").write_bytes(b"RRF2")
    assert open_viewer(tmp_path / "x.rrd") == 7
    (command,) = commands
    assert command[:3] == [sys.executable, "-m", "rerun"] and command[-1] == str(tmp_path / "x.rrd")
    assert command[command.index("--bind") + 1] == "127.0.0.1" and "--new" in command


def test_missing_recording_is_a_one_line_error(tmp_path: Path) -> None:
    with pytest.raises(AsfmError, match=r"^[^\n]*x.rrd: expected a recording, found no file[^\n]*$"):
        open_viewer(tmp_path / "x.rrd")
