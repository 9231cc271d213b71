"""True elevations and noise-free images of the native folder."""

import zipfile
from pathlib import Path

import numpy as np

from asfm.datasets.native.reader import open_native_truth
from asfm.datasets.native.writer import write_native
from asfm.types import FrameTruth
from tests.datasets.sequences import make_sequence


def test_truth_survives_and_is_deterministic(tmp_path: Path) -> None:
    sequence = make_sequence()
    elevation_rad = np.where(np.arange(96).reshape(12, 8) % 3 == 0, np.nan, np.linspace(-0.1, 0.1, 96).reshape(12, 8))

    def truth(index: int) -> FrameTruth:
        return FrameTruth(elevation_rad + 0.001 * index, sequence.read_frame(index).image)

    for name in ("a", "b"):
        write_native(tmp_path / name, sequence, truth=truth)
    read = open_native_truth(tmp_path / "a")
    assert read is not None
    for index in range(3):
        found = read(index)
        np.testing.assert_allclose(found.elevation_rad, truth(index).elevation_rad, atol=1e-7)
        np.testing.assert_array_equal(found.clean, truth(index).clean)
    files = sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file())
    assert all((tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes() for file in files)
    with zipfile.ZipFile(tmp_path / "a" / "truth" / "000000.npz") as archive:
        assert {entry.date_time[0] for entry in archive.infolist()} == {1980}, "no clock in the bytes"
