"""``asfm convert``: images and truth kept, and 16 bits only where they are needed."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from asfm.commands import convert_sequence
from asfm.datasets import open_sequence

Ask = Callable[..., str]


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
