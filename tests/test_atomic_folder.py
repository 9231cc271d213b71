"""Output folders appear complete or not at all, and files of others are never deleted."""

import errno
import os
import signal
import subprocess
import sys
import time
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from asfm.atomic_folder import FolderKind, atomic_folder
from asfm.errors import AsfmError

KIND = FolderKind(
    "results", ("report.json", "config.yaml"), ("report.json", "config.yaml", "points.ply", "a", "a/*.png")
)


def open_folder(path: Path, overwrite: bool = False) -> AbstractContextManager[Path]:
    return atomic_folder(path, KIND, overwrite)


def _fill(folder: Path, text: str) -> None:
    (folder / "config.yaml").write_text(text)
    (folder / "report.json").write_text("{}")


def _snapshot(root: Path) -> dict[str, str]:
    return {str(file.relative_to(root)): file.read_text() for file in root.rglob("*") if file.is_file()}


def test_folder_appears_only_when_complete(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    with open_folder(out, overwrite=False) as folder:
        assert folder.parent == out.parent and folder.name.endswith(".partial")
        _fill(folder, "new")
        assert not out.exists()
    assert _snapshot(tmp_path) == {"deep/out/config.yaml": "new", "deep/out/report.json": "{}"}
    ordinary = tmp_path / "ordinary"
    ordinary.mkdir()
    assert out.stat().st_mode == ordinary.stat().st_mode


@pytest.mark.parametrize("fault", [RuntimeError, KeyboardInterrupt, SystemExit, AsfmError])
@pytest.mark.parametrize("existing", [False, True])
def test_exception_in_the_body_changes_nothing(tmp_path: Path, fault: type[BaseException], existing: bool) -> None:
    out = tmp_path / "out"
    if existing:
        out.mkdir()
        _fill(out, "old")
    before = _snapshot(tmp_path)
    with pytest.raises(fault), open_folder(out, overwrite=True) as folder:
        _fill(folder, "half")
        raise fault
    assert _snapshot(tmp_path) == before
    assert [path.name for path in tmp_path.iterdir()] == (["out"] if existing else [])


def test_overwriting_leaves_no_other_files(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    _fill(out, "old")
    (out / "points.ply").write_text("old")
    (out / "a").mkdir()
    (out / "a" / "0.png").write_text("old")
    with pytest.raises(AsfmError, match="already holds results"), open_folder(out, overwrite=False):
        pass
    with open_folder(out, overwrite=True) as folder:
        _fill(folder, "new")
    assert _snapshot(tmp_path) == {"out/config.yaml": "new", "out/report.json": "{}"}
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_empty_folder_is_replaced(tmp_path: Path) -> None:
    with open_folder(tmp_path / "out", overwrite=False) as folder:
        _fill(folder, "new")
    assert (tmp_path / "out" / "config.yaml").read_text() == "new"


@pytest.mark.parametrize(
    "names",
    [
        ["notes.txt"],
        ["report.json"],
        ["report.json", "config.yaml", "notes.txt"],
        ["report.json", "config.yaml", "a/b"],
    ],
)
def test_folder_with_foreign_files_is_refused(tmp_path: Path, names: list[str]) -> None:
    out = tmp_path / "out"
    out.mkdir()
    for name in names:
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_text("precious")
    before = _snapshot(tmp_path)
    with pytest.raises(AsfmError, match="another folder"), open_folder(out, overwrite=True):
        pytest.fail("the body must not run")
    assert _snapshot(tmp_path) == before


def test_file_and_working_directory_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("precious")
    with pytest.raises(AsfmError, match="found a file"), open_folder(tmp_path / "file", overwrite=True):
        pass
    monkeypatch.chdir(tmp_path)
    with pytest.raises(AsfmError, match="working directory"), open_folder(Path(), overwrite=True):
        pass


def test_foreign_file_created_meanwhile_and_the_output_both_survive(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(AsfmError, match="the complete output is in") as caught, open_folder(out, True) as folder:
        _fill(folder, "new")
        out.mkdir()
        (out / "notes.txt").write_text("precious")
    assert (out / "notes.txt").read_text() == "precious"
    kept = Path(str(caught.value).partition("the complete output is in ")[2])
    assert kept.suffix == ".complete" and (kept / "config.yaml").read_text() == "new"


def test_old_folder_is_restored_when_the_last_rename_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    out.mkdir()
    _fill(out, "old")
    rename = Path.rename

    def refuse(self: Path, target: Path) -> Path:
        if self.suffix == ".partial":
            raise PermissionError(13, "no")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", refuse)
    with pytest.raises(AsfmError, match="the complete output is in"), open_folder(out, overwrite=True) as folder:
        _fill(folder, "new")
    assert (out / "config.yaml").read_text() == "old" and (folder / "config.yaml").read_text() == "new"


def test_symbolic_link_is_kept(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "real")
    with open_folder(tmp_path / "link", overwrite=False) as folder:
        _fill(folder, "new")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "real" / "config.yaml").read_text() == "new"


@pytest.mark.skipif(os.name != "posix", reason="sends POSIX signals")
@pytest.mark.parametrize(("sent", "left_behind"), [(signal.SIGINT, 0), (signal.SIGKILL, 1)])
def test_stopped_process_leaves_no_output(tmp_path: Path, sent: signal.Signals, left_behind: int) -> None:
    out = tmp_path / "out"
    code = (
        "import sys, time, pathlib; from asfm.atomic_folder import *\n"
        "with atomic_folder(pathlib.Path(sys.argv[1]), FolderKind('x', (), ()), False) as folder:\n"
        "    (folder / 'report.json').write_text('{}'); time.sleep(60)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code, str(out)], stderr=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 30
        while not list(tmp_path.glob("*.partial/report.json")) and time.monotonic() < deadline:
            time.sleep(0.02)
        assert list(tmp_path.glob("*.partial/report.json"))
        process.send_signal(sent)
        assert process.wait(timeout=30) != 0
    finally:
        process.kill()
    assert not out.exists()
    assert len(list(tmp_path.glob("out.*.partial"))) == left_behind == len(list(tmp_path.iterdir()))


def test_unwritable_parent_is_a_one_line_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(AsfmError, match=r"^[^\n]*cannot make a folder[^\n]*$"), open_folder(tmp_path / "file" / "out"):
        pytest.fail("the body must not run")
    with pytest.raises(AsfmError, match="cannot look into it: File name too long"), open_folder(tmp_path / ("x" * 300)):
        pytest.fail("the body must not run")


@pytest.mark.parametrize("overwrite", [False, True])
def test_full_disk_is_a_one_line_error_and_leaves_nothing(tmp_path: Path, overwrite: bool) -> None:
    with pytest.raises(AsfmError, match="out: cannot write: No space left on device"), open_folder(tmp_path / "out"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    with pytest.raises(AsfmError, match="out: cannot write: Is a directory"), open_folder(tmp_path / "out") as folder:
        folder.write_text("a folder cannot be written as a file")
    assert list(tmp_path.iterdir()) == []


def test_errors_unrelated_to_the_folder_are_passed_on(tmp_path: Path) -> None:
    for error in (BrokenPipeError(errno.EPIPE, "pipe"), FileNotFoundError(errno.ENOENT, "none", "elsewhere")):
        with pytest.raises(type(error)), open_folder(tmp_path / "out"):
            raise error
    assert list(tmp_path.iterdir()) == []
