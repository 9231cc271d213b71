"""A small corpus of damaged files: every reader loads each, or refuses it in one line."""

from pathlib import Path

import pytest

from tools.fuzz.__main__ import run_target
from tools.fuzz.targets import TARGETS, Target


@pytest.mark.parametrize("name", TARGETS)
def test_damaged_files_load_or_are_refused(tmp_path: Path, name: str) -> None:
    assert run_target(TARGETS[name], tmp_path / "seed", cases=24, seed=0) == []


def test_a_reader_that_fails_is_reported(tmp_path: Path) -> None:
    def make(folder: Path) -> None:
        folder.mkdir()
        (folder / "x").write_bytes(b"valid")

    def read(folder: Path) -> object:
        return {b"valid": 1}[(folder / "x").read_bytes()]

    found = run_target(Target("x", make, read), tmp_path / "seed", cases=5, seed=0)
    assert len(found) == 5 and all("KeyError" in line for line in found)
