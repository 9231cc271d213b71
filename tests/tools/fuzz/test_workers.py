"""Fuzz workers: crashes, hangs, memory and printing count as failures, and the other cases are still read."""

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tools.fuzz import workers
from tools.fuzz.cases import Target
from tools.fuzz.workers import run_here, run_target


def fuzz(folder: Path, fail: Callable[[], object], failing: int = 2) -> list[str]:
    """Read four cases, of which one fails in a way of its own, and return the failures."""

    def make(place: Path) -> None:
        place.mkdir()
        (place / "x").write_bytes(b"valid")

    def read(place: Path) -> object:
        with (place / "reads").open("a") as file:
            file.write(".")
        return fail() if (place / "reads").stat().st_size == failing + 2 else None  # the first read is the valid file

    count = run_target(Target("x", make, read), folder / "seed", cases=4, seed=0)
    assert count.cases == 4 and count.loaded == 3 and count.refused == 0
    return count.failures


def test_a_crash_is_reported_with_its_case(tmp_path: Path) -> None:
    crash = lambda: os.kill(os.getpid(), signal.SIGKILL)  # noqa: E731
    assert fuzz(tmp_path, crash) == ["case 2: the process ends with -9"]


def test_a_hang_that_python_cannot_stop_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "SILENCE_S", 0.5)
    assert fuzz(tmp_path, lambda: time.sleep(60)) == ["case 2: hangs for 0.5 s"]


def test_memory_beyond_the_bound_is_reported(tmp_path: Path) -> None:
    (failure,) = fuzz(tmp_path, lambda: bytearray(2 << 30))
    assert failure.startswith("case 2: MemoryError")


def test_what_a_library_prints_is_reported(tmp_path: Path) -> None:
    (failure,) = fuzz(tmp_path, lambda: os.write(2, b"libpng warning"))
    assert failure == "case 2: a library prints 'libpng warning'"


def test_cases_are_the_same_in_a_worker_and_here(tmp_path: Path) -> None:
    def make(folder: Path) -> None:
        folder.mkdir()
        (folder / "x").write_bytes(b"1 2 3\n4 5 6\n")

    def read(folder: Path) -> object:
        raise ValueError((folder / "x").read_bytes().hex() if (folder / "x").stat().st_size != 12 else "")

    def read_unless_valid(folder: Path) -> object:
        return None if (folder / "x").read_bytes() == b"1 2 3\n4 5 6\n" else read(folder)

    target = Target("x", make, read_unless_valid)
    forked, here = run_target(target, tmp_path / "a", 6, 3), run_here(target, tmp_path / "b", 6, 3)
    assert forked.failures == here.failures and len(forked.failures) >= 5
