"""Single fuzz cases: what is judged as a failure."""

from collections.abc import Callable
from pathlib import Path

import pytest

from asfm.errors import AsfmError
from tools.fuzz import cases
from tools.fuzz.cases import LOADED, REFUSED, Target, run_case


def run(folder: Path, read: Callable[[Path], object], pack: Callable[[bytes], bytes] | None = None) -> str:
    return run_case(Target("x", lambda _: None, read, pack), folder, b"valid", (0, 0))


def raise_error(error: Exception) -> Callable[[Path], object]:
    def read(_: Path) -> object:
        raise error

    return read


def test_outcomes(tmp_path: Path) -> None:
    assert run(tmp_path, lambda folder: (folder / "x").read_bytes()) == LOADED
    assert run(tmp_path, raise_error(AsfmError("no"))) == REFUSED
    assert run(tmp_path, raise_error(KeyError("k"))).startswith("KeyError: \"'k'\" at test_cases.py:")
    assert run(tmp_path, raise_error(MemoryError())).startswith("MemoryError")


def test_a_reader_that_takes_long_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def read(_: Path) -> object:
        while True:
            pass

    monkeypatch.setattr(cases, "SECONDS", 0.02)
    assert run(tmp_path, read).startswith("TimeoutError: 'longer than 0.02 s'")


def test_the_mutated_bytes_are_packed_and_written(tmp_path: Path) -> None:
    found: list[bytes] = []
    run(tmp_path, lambda folder: found.append((folder / "x").read_bytes()), pack=lambda content: b"<" + content + b">")
    run(tmp_path, lambda folder: found.append((folder / "x").read_bytes()))
    assert found[0] == b"<" + found[1] + b">" and found[1] != b"valid"
