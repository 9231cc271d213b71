"""Regular files: whatever else is at a path is named before it is opened."""

import os
import socket
import tracemalloc
from pathlib import Path

import pytest

from asfm.errors import AsfmError
from asfm.regular_file import check_file, check_inside, is_present, is_regular, open_file, read_file, read_text


def make_pipe(path: Path) -> None:
    os.mkfifo(path)


def make_socket(path: Path) -> None:
    os.chdir(path.parent)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(path.name)


@pytest.mark.parametrize(
    ("make", "found"),
    [
        (lambda path: None, "none"),
        (Path.mkdir, "a folder"),
        (make_pipe, r"a named pipe \(FIFO\)"),
        (make_socket, "a socket"),
        (lambda path: path.symlink_to("/dev/zero"), "a device"),
        (lambda path: path.symlink_to("gone"), "a link to 'gone', which is missing: mend the link or remove it"),
        (
            lambda path: path.symlink_to("x"),
            "a link to 'x', which is missing: .*|none that .*",
        ),
        (lambda path: path.write_bytes(bytes(11)), "11"),
    ],
)
def test_what_is_no_regular_file_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make: object, found: str
) -> None:
    monkeypatch.chdir(tmp_path)
    make(tmp_path / "x")  # type: ignore[operator]
    for read in (check_file, open_file, read_file, read_text):
        with pytest.raises(AsfmError, match=rf"x: expected a table(?: of 10 bytes at most)?, found (?:{found})$"):
            read(tmp_path / "x", "a table", 10)


def test_names_that_no_file_can_have_are_refused() -> None:
    for name in ("a\0b", "x" * 5000):
        assert not is_present(Path(name)) and not is_regular(Path(name))
        with pytest.raises(AsfmError, match="expected a table, found"):
            read_file(Path(name), "a table")


def test_files_are_read_whole(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"\xef\xbb\xbfa\n")
    (tmp_path / "link").symlink_to("x")
    assert read_file(tmp_path / "link", "text") == b"\xef\xbb\xbfa\n"
    assert read_text(tmp_path / "x", "text") == "a\n" and check_file(tmp_path / "x", "text") == 5
    assert is_present(tmp_path / "link") and is_regular(tmp_path / "link")


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"a\n\xff", "line|the byte 0xff at 2, which is no UTF-8"),
        (b"a\nb\0", "a NUL byte"),
        (b"\x89PNG\r\n\x1a\n", "a PNG image"),
        (b" <!DOCTYPE HTML>", "a web page: the download has failed"),
        (b"\x1f\x8b\0\0", "a gzip file: unpack it"),
        ("a\n".encode("utf-16"), "text in UTF-16: save it as UTF-8"),
    ],
)
def test_text_that_is_none_is_named(tmp_path: Path, content: bytes, found: str) -> None:
    (tmp_path / "x.csv").write_bytes(content)
    with pytest.raises(AsfmError, match=rf"x\.csv.*: expected a table.*, found (?:{found})"):
        read_text(tmp_path / "x.csv", "a table")


def test_paths_that_lead_outside_a_folder_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    (folder / "deeper").mkdir(parents=True)
    (tmp_path / "secret").touch()
    (tmp_path / "in2").mkdir()
    (folder / "link").symlink_to("../secret")
    (folder / "out").symlink_to("../in2")
    (folder / "fine").symlink_to("deeper/x")
    (tmp_path / "same").symlink_to("in")
    for name in ("deeper/x", "fine", "deeper/../y", "."):
        check_inside(folder, folder / name, "an image")
        check_inside(tmp_path / "same", tmp_path / "same" / name, "an image")
    for name in ("../secret", "link", "out/x", "../in2/x", str(tmp_path / "secret"), "deeper/../../secret"):
        with pytest.raises(AsfmError, match=r"leads outside, to .*: copy the file into the folder"):
            check_inside(folder, folder / name, "an image")


def test_a_small_file_takes_little_memory_whatever_its_limit(tmp_path: Path) -> None:
    """Python takes the memory for as many bytes as it is asked to read."""
    path = tmp_path / "x"
    path.write_bytes(b"content")
    tracemalloc.start()
    try:
        assert read_file(path, "a table", max_bytes=1 << 30) == b"content"
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()
