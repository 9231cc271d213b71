"""A small corpus of damaged files: every reader loads each, or refuses it in one line."""

import shutil
from pathlib import Path

import pytest

from tools.fuzz.results_seeds import RESULTS_TARGETS
from tools.fuzz.targets import TARGETS
from tools.fuzz.workers import run_here

SLOW = [name for name, target in RESULTS_TARGETS.items() if target.file not in ("report.json", "c.yaml")]
"""They evaluate a whole results folder."""


@pytest.mark.parametrize("name", TARGETS)
def test_the_valid_file_loads_and_damaged_ones_load_or_are_refused(tmp_path: Path, name: str) -> None:
    target, folder = TARGETS[name], tmp_path / "seed"
    assert run_here(target, folder, cases=2 if name in SLOW else 8, seed=0).failures == []
    shutil.rmtree(folder)
    target.make(folder)
    content = (folder / target.file).read_bytes()
    content = content if target.unpack is None else target.unpack(content)
    (folder / target.file).write_bytes(content if target.pack is None else target.pack(content))
    target.read(folder)
