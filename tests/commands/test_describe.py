"""``asfm info``: rows that describe a sequence."""

import re
from collections.abc import Callable
from pathlib import Path

from asfm.commands import simulate_to
from asfm.commands.simulate import SimulationOptions


def test_info_describes_a_sequence(tmp_path: Path, ask: Callable[..., str]) -> None:
    simulate_to("seafloor", tmp_path / "seafloor", SimulationOptions(frames=2))
    rows = dict(re.split(r"  +", line, maxsplit=1) for line in ask("info", tmp_path / "seafloor").splitlines())
    assert rows["frames"] == "2" and rows["format"] == "native"
    assert rows["image"] == "600 ranges x 256 beams" and rows["ground truth"].startswith("2 poses")
