"""Locks on temporary folders: leftovers of dead processes go, folders of living processes and of other hosts stay."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from asfm.folder_lock import find_temporaries, lock_folder, name_temporary, remove_leftovers

pytestmark = pytest.mark.skipif(os.name != "posix", reason="folders are not locked")
HOLD = "import sys; from pathlib import Path; from asfm.folder_lock import lock_folder\n"
HOLD += "with lock_folder(Path(sys.argv[1])) as locked: print(locked, flush=True); sys.stdin.read()"


def make_temporary(path: Path, suffix: str = "partial") -> Path:
    folder = name_temporary(path, suffix)
    (folder / "deep").mkdir(parents=True)
    return folder


def test_only_leftovers_of_this_host_are_removed(tmp_path: Path) -> None:
    path = tmp_path / "out"
    left = make_temporary(path)
    host = left.name.split(".")[1].split("-")[0]
    others = [
        left.with_name(left.name.replace(host, "0" * len(host))),
        left.with_name("out.partial"),
        left.with_name(f"out.{host}-notes.partial"),
        left.with_name(f"out.{host}-1-12345678.results"),
        make_temporary(tmp_path / "outer"),
        tmp_path / "out",
    ]
    for other in others:
        other.mkdir(exist_ok=True)
    remove_leftovers(path, "partial")
    assert not left.exists() and all(other.is_dir() for other in others)


def test_the_folder_of_a_living_process_stays_until_it_is_killed(tmp_path: Path) -> None:
    folder = make_temporary(tmp_path / "out")
    command = [sys.executable, "-c", HOLD, str(folder)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None and owner.stdout.readline() == "True\n"
        with lock_folder(folder) as locked:
            assert not locked
        remove_leftovers(tmp_path / "out", "partial")
        assert folder.is_dir()
        owner.kill()
    remove_leftovers(tmp_path / "out", "partial")
    assert not folder.exists()


def test_links_and_missing_places_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "precious").mkdir()
    link = name_temporary(tmp_path / "out", "partial")
    link.symlink_to(tmp_path / "precious")
    remove_leftovers(tmp_path / "out", "partial")
    assert link.is_symlink() and find_temporaries(tmp_path / "none" / "out", "partial") == []
    with lock_folder(tmp_path / "none") as locked:
        assert not locked
