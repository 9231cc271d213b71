"""True elevations and noise-free images of the native folder."""

import zipfile
from pathlib import Path

import numpy as np
import pytest

from asfm.datasets.images import Bits
from asfm.datasets.native.reader import open_native_truth
from asfm.datasets.native.truth import read_truth_file, write_truth_file
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError
from asfm.types import FrameTruth
from tests.datasets.sequences import make_sequence

SHAPE = (3, 5)


def test_truth_survives_the_round_trip_and_its_bytes_are_reproducible(tmp_path: Path) -> None:
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
        assert {entry.date_time[0] for entry in archive.infolist()} == {1980}, "no time of writing in the bytes"


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("descending", [False, True])
def test_a_file_is_read_back_with_column_0_to_starboard(tmp_path: Path, bits: Bits, descending: bool) -> None:
    rng = np.random.default_rng(bits)
    elevation_rad = rng.uniform(-0.1, 0.1, SHAPE).astype(np.float32).astype(np.float64)
    elevation_rad[1, 2] = np.nan
    clean = (rng.integers(0, 2**bits, SHAPE) / np.float32(2**bits - 1)).astype(np.float32)
    write_truth_file(tmp_path / "a.npz", FrameTruth(elevation_rad, clean), bits)
    found = read_truth_file(tmp_path / "a.npz", SHAPE, descending)
    step = -1 if descending else 1
    np.testing.assert_array_equal(found.elevation_rad, elevation_rad[:, ::step])
    np.testing.assert_array_equal(found.clean, clean[:, ::step])
    assert found.elevation_rad.dtype == np.float64 and found.clean.dtype == np.float32


def test_a_clean_image_of_floats_is_clipped_to_0_to_1(tmp_path: Path) -> None:
    clean = np.full(SHAPE, 0.5)
    clean[0, :3] = [-1, 2, np.nan]
    np.savez(tmp_path / "a.npz", elevation_rad=np.zeros(SHAPE), clean=clean)
    found = read_truth_file(tmp_path / "a.npz", SHAPE, descending=False).clean
    np.testing.assert_array_equal(found[0, :4], [0, 1, 0, 0.5])


GOOD = {"elevation_rad": np.zeros(SHAPE), "clean": np.zeros(SHAPE, np.uint8)}


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"clean": GOOD["clean"]}, "expected an array elevation_rad, found clean"),
        ({"elevation_rad": GOOD["elevation_rad"]}, "expected an array clean, found elevation_rad"),
        ({}, "expected an array elevation_rad, found none"),
        (
            GOOD | {"clean": np.zeros((3, 4), np.uint8)},
            r"expected clean of shape \(3, 5\) .*, found \(3, 4\)",
        ),
        (GOOD | {"clean": np.zeros(SHAPE, np.int64)}, "expected clean to hold numbers, found int64"),
        (GOOD | {"elevation_rad": np.full(SHAPE, "up")}, "expected elevation_rad to hold numbers, found <U2"),
        (GOOD | {"clean": np.full(SHAPE, None)}, "expected clean to hold numbers, found object"),
    ],
)
def test_a_fault_of_an_array_is_reported(tmp_path: Path, arrays: dict[str, np.ndarray], message: str) -> None:
    np.savez(tmp_path / "a.npz", **arrays)  # type: ignore[arg-type]
    with pytest.raises(AsfmError, match=rf"a\.npz: {message}") as error:
        read_truth_file(tmp_path / "a.npz", SHAPE, descending=False)
    assert "\n" not in str(error.value)


def test_a_missing_or_damaged_file_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    with pytest.raises(AsfmError, match=r"a\.npz: expected the truth of a frame, found none"):
        read_truth_file(path, SHAPE, descending=False)
    np.savez(path, **GOOD)  # type: ignore[arg-type]
    whole = path.read_bytes()
    for content in (b"text", whole[: len(whole) // 2], whole.replace(bytes(20), bytes(19) + b"x", 1)):
        path.write_bytes(content)
        with pytest.raises(AsfmError, match=r"a\.npz: expected an \.npz with elevation_rad and clean"):
            read_truth_file(path, SHAPE, descending=False)
