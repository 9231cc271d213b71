"""``asfm info``, ``asfm view`` and ``asfm convert``."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from asfm.cli import run_command_line
from asfm.commands import convert_sequence
from asfm.datasets import open_sequence

Ask = Callable[..., str]

FRAMES = 6


def test_info_describes_a_sequence(demo_folder: Path, ask: Ask) -> None:
    rows = dict(re.split(r"  +", line, maxsplit=1) for line in ask("info", demo_folder / "seafloor").splitlines())
    assert rows["frames"] == str(FRAMES) and rows["format"] == "native"
    assert rows["image"] == "600 ranges x 256 beams" and rows["ground truth"].startswith(f"{FRAMES} poses")


def test_view_opens_the_recording(demo_folder: Path, tmp_path: Path, ask: Ask, capsys: Any, monkeypatch: Any) -> None:
    opened: list[Path] = []

    def open_viewer(path: Path) -> int:
        opened.append(path)
        return 0

    monkeypatch.setattr("asfm.visualization.viewer.open_viewer", open_viewer)
    ask("view", demo_folder / "results")
    ask("view", demo_folder / "results" / "reconstruction.rrd")
    assert opened == [demo_folder / "results" / "reconstruction.rrd"] * 2
    monkeypatch.setattr("asfm.visualization.viewer.open_viewer", lambda path: 3)
    assert run_command_line(["view", str(demo_folder / "results")]) == 2
    assert "ended with code 3" in capsys.readouterr().err
    monkeypatch.undo()
    assert run_command_line(["view", str(tmp_path)]) == 2
    assert "expected a recording" in capsys.readouterr().err


def test_convert_keeps_images_and_truth(demo_folder: Path, tmp_path: Path, ask: Ask) -> None:
    ask("convert", demo_folder / "seafloor", tmp_path / "copy")
    source, copy = open_sequence(demo_folder / "seafloor"), open_sequence(tmp_path / "copy")
    for before, after in zip(source, copy, strict=True):
        np.testing.assert_array_equal(after.image, before.image)
    assert (tmp_path / "copy" / "truth" / "000001.npz").is_file()
    convert_sequence(demo_folder / "seafloor", tmp_path / "fine", bits=16)
    convert_sequence(tmp_path / "fine", tmp_path / "coarse")
    sizes = [(tmp_path / name / "frames" / "000000.png").stat().st_size for name in ("copy", "fine", "coarse")]
    assert sizes[0] == sizes[2] < sizes[1], "16 bits only where 8 would lose something"
