"""Recording files: full, slow and unwritable disks."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asfm.errors import AsfmError
from asfm.visualization.rerun_stream import RerunStream


def open_stream(path: Path) -> RerunStream:
    return RerunStream(path, "toy", "toy", np.arange(3.0))


def test_unwritable_file_is_a_one_line_error(tmp_path: Path) -> None:
    with pytest.raises(AsfmError, match=r"^[^\n]*none/x.rrd: cannot write the recording: [^\n]*$"):
        open_stream(tmp_path / "none" / "x.rrd")


class _FailingStream:
    """Stream whose first flushes fail as those of Rerun do."""

    def __init__(self, stream: Any, failures: int) -> None:
        self.stream, self.failures = stream, failures
        self.calls: list[str] = []

    def flush(self, *, timeout_sec: float) -> None:
        self.calls.append("flush")
        assert 0 < timeout_sec < 5
        if len(self.calls) <= self.failures:
            raise RuntimeError("File-writer thread\nshut down prematurely")

    def disconnect(self) -> None:
        self.calls.append("disconnect")
        self.stream.disconnect()


@pytest.fixture
def failing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[RerunStream, _FailingStream]:
    recording = open_stream(tmp_path / "x.rrd")
    stream = _FailingStream(recording._stream, 2)
    monkeypatch.setattr(recording, "_stream", stream)
    return recording, stream


def test_failure_to_finish_is_a_one_line_error(
    failing: tuple[RerunStream, _FailingStream], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("asfm.visualization.rerun_stream.CLOSE_TIMEOUT_S", 2.0)
    with pytest.raises(AsfmError) as caught:
        failing[0].close()
    expected = f"{tmp_path / 'x.rrd'}: cannot write the recording: File-writer thread shut down prematurely"
    assert str(caught.value) == expected
    assert failing[1].calls == ["flush", "flush", "disconnect"]


def test_slow_disk_gets_more_time(failing: tuple[RerunStream, _FailingStream]) -> None:
    failing[0].close()
    assert failing[1].calls == ["flush", "flush", "flush", "disconnect"]


FULL_DISK = """
import resource, sys
from pathlib import Path
import numpy as np
from asfm.errors import AsfmError
from asfm.sequence import Sequence
from asfm.geometry.sonar import SonarModel
from asfm.types import Frame, Keypoints
from asfm.visualization.rerun_recorder import RerunRecorder

limit, shape = int(sys.argv[2]), (200, 100)
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
sonar = SonarModel.evenly_spaced("toy", (0.5, 8.0), (-0.6, 0.5), shape, 0.2)
none = np.zeros(0)
keypoints = Keypoints(np.zeros((0, 2)), none, none, none, np.zeros((0, 61), np.uint8), np.zeros((0, 3, 3), np.float32))
rng = np.random.default_rng(0)
frames = [Frame(i, float(i), rng.random(shape, np.float32), np.zeros(shape, bool)) for i in range(4)]
try:
    recorder = RerunRecorder(Path(sys.argv[1]), Sequence("toy", sonar, np.arange(4.0), frames.__getitem__))
    for frame in frames:
        recorder.record_frame(frame, ~frame.invalid, keypoints)
    recorder.close()
except AsfmError as error:
    sys.exit(f"FAULT {error}")
"""


@pytest.mark.skipif(sys.platform == "win32", reason="file sizes cannot be limited")
@pytest.mark.parametrize(("limit", "written"), [(0, False), (20_000, False), (50_000_000, True)])
def test_full_disk_is_a_one_line_error(tmp_path: Path, limit: int, written: bool) -> None:
    path = tmp_path / "toy.rrd"
    command = [sys.executable, "-c", FULL_DISK, str(path), str(limit)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=90, check=False)
    fault = [line for line in done.stderr.splitlines() if line.startswith("FAULT")]
    assert len(fault) == (0 if written else 1), done.stderr
    assert done.returncode == (0 if written else 1), done.stderr
    assert all(line.startswith(f"FAULT {path}: cannot write the recording: ") for line in fault)
