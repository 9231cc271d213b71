"""Recording files: all that comes through the pipe, or the first error of the disk, and nobody waits for ever."""

import errno
import os
from pathlib import Path

import pytest

from asfm.errors import AsfmError
from asfm.visualization.recording_file import RecordingFile

NEEDS_PIPES = pytest.mark.skipif(not Path("/dev/fd").exists(), reason="the system does not name pipes")


@NEEDS_PIPES
@pytest.mark.parametrize("size", [0, 1, 1_000_003])
def test_the_file_holds_what_was_written(tmp_path: Path, size: int) -> None:
    data = os.urandom(size)
    file = RecordingFile(tmp_path / "x")
    with open(file.name, "wb") as sink:  # noqa: PTH123 - as Rerun opens it
        file.release_sink()
        sink.write(data)
    file.close(10.0)
    assert (tmp_path / "x").read_bytes() == data


class _FullDisk:
    def write(self, data: memoryview) -> int:
        if len(data) > 10:
            return 10  # a disk may take a part
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def close(self) -> None: ...


@NEEDS_PIPES
def test_a_full_disk_stops_no_writer_and_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = RecordingFile(tmp_path / "x")
    monkeypatch.setattr(file, "_file", _FullDisk())
    with open(file.name, "wb") as sink:  # noqa: PTH123 - as Rerun opens it
        file.release_sink()
        sink.write(bytes(1_000_000))  # more than the pipe holds
    message = r"x: cannot write the recording: No space left on device$"
    with pytest.raises(AsfmError, match=message):
        file.close(10.0)
    with pytest.raises(AsfmError, match=message):
        file.require_written()


@NEEDS_PIPES
def test_a_pipe_that_stays_open_is_given_up(tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "x")
    with pytest.raises(AsfmError, match=r"not finished after 0.1 s"):
        file.close(0.1)
    file.release_sink()


def test_a_folder_in_place_of_the_file_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(AsfmError, match=r"^[^\n]*: cannot write the recording: [^\n]*$"):
        RecordingFile(tmp_path)
