"""Validated reading of HDF5 files from other programs."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from asfm.datasets.hloc.hdf5 import MAX_ARRAY_SIZE, find_groups, open_hdf5, read_array
from asfm.errors import AsfmError


@pytest.mark.filterwarnings("error")
def test_what_was_written_is_read_with_its_type(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    arrays: dict[str, NDArray[Any]] = {
        "half": np.array([0.5, 1.5], np.float16),
        "int": np.array([[1, -2]], np.int32),
        "byte": np.array([7], np.uint8),
        "none": np.zeros((0, 2)),
    }
    with open_hdf5(path, "w") as file:
        for name, values in arrays.items():
            file[f"group/{name}"] = values
    with open_hdf5(path) as file:
        for name, values in arrays.items():
            found = read_array("a.h5", file["group"], name, values.shape)
            assert found.dtype == values.dtype
            np.testing.assert_array_equal(found, values)


def test_a_file_that_cannot_be_opened_is_reported_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "text.h5").write_text("no HDF5")
    for path, message in (
        (tmp_path / "none.h5", r"none\.h5: expected an HDF5 file, found none"),
        (tmp_path, r"expected an HDF5 file, found a folder"),
        (tmp_path / "text.h5", r"text\.h5: cannot read as HDF5"),
    ):
        with pytest.raises(AsfmError, match=message) as error, open_hdf5(path):
            pass
        assert "\n" not in str(error.value)
    with pytest.raises(AsfmError, match="cannot write"), open_hdf5(tmp_path / "none" / "a.h5", "w"):
        pass


def test_an_error_inside_the_block_names_the_file(tmp_path: Path) -> None:
    with open_hdf5(tmp_path / "a.h5", "w") as file:
        file["x"] = 1
    with pytest.raises(AsfmError, match=r"a\.h5: cannot read as HDF5"), open_hdf5(tmp_path / "a.h5") as file:
        file["y"]


def test_groups_are_found_at_any_depth_and_links_are_not_followed(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with open_hdf5(path, "w") as file:
        for name in ("a", "b/c", "b/d/e"):
            file[f"{name}/keypoints"] = np.zeros((1, 2))
        file["b/other/x"] = 1
        file["soft"] = h5py.SoftLink("/a")
        file["outside"] = h5py.ExternalLink("/etc/x.h5", "/y")
    with open_hdf5(path) as file:
        found = find_groups(path, file, "keypoints")
        assert sorted(name for name, _ in found) == ["a", "b/c", "b/d/e"]
        assert all(group["keypoints"].shape == (1, 2) for _, group in found)
        with pytest.raises(AsfmError, match=r"a\.h5: expected groups that hold 'matches0', found none"):
            find_groups(path, file, "matches0")


@pytest.mark.parametrize(
    ("values", "shape", "message"),
    [
        (np.zeros((2, 3)), (2, 2), r"of the shape \[2, 2\], found \[2, 3\]"),
        (np.zeros((2, 3)), (None, 4), r"of the shape \['any', 4\], found \[2, 3\]"),
        (np.zeros(2), (None, 2), r"found \[2\]"),
        (np.array(1.0), (None,), r"found \[\]"),
        (
            np.array([[0, 0], [0, np.inf]]),
            (2, 2),
            r"finite numbers in x, found NaN, infinity or more than 1e\+30, the first in row 1",
        ),
        ("text", (None,), "expected numbers in x, found"),
        (np.array([1j]), (1,), "expected numbers in x, found complex128"),
        (np.array([True]), (1,), "expected numbers in x, found bool"),
    ],
)
def test_other_arrays_are_refused(tmp_path: Path, values: Any, shape: tuple[int | None, ...], message: str) -> None:
    with open_hdf5(tmp_path / "a.h5", "w") as file:
        file["x"] = values
    with open_hdf5(tmp_path / "a.h5") as file, pytest.raises(AsfmError, match=rf"a\.h5, pair: .*{message}"):
        read_array("a.h5, pair", file, "x", shape)


def test_a_group_is_no_array(tmp_path: Path) -> None:
    with open_hdf5(tmp_path / "a.h5", "w") as file:
        file.create_group("x")
        with pytest.raises(AsfmError, match="expected numbers in x, found a group"):
            read_array("a.h5", file, "x", (None,))


def test_a_huge_array_is_refused_before_it_is_allocated(tmp_path: Path) -> None:
    with open_hdf5(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", shape=(MAX_ARRAY_SIZE + 1,), dtype="f8", chunks=(1024,))
    assert (tmp_path / "a.h5").stat().st_size < 100_000
    with open_hdf5(tmp_path / "a.h5") as file, pytest.raises(AsfmError, match="expected x of the shape"):
        read_array("a.h5", file, "x", (None,))


@pytest.mark.parametrize("kind", ["soft", "external link", "external storage", "virtual"])
def test_numbers_stored_elsewhere_are_refused(tmp_path: Path, kind: str) -> None:
    (tmp_path / "secret").write_bytes(bytes(8))
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.zeros(1)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["y"] = np.zeros(1)
        if kind == "soft":
            file["x"] = h5py.SoftLink("/y")
        elif kind == "external link":
            file["x"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/x")
        elif kind == "external storage":
            file.create_dataset("x", (1,), "f8", external=[(str(tmp_path / "secret"), 0, 8)])
        else:
            layout = h5py.VirtualLayout((1,), "f8")
            layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "x", (1,))
            file.create_virtual_dataset("x", layout)
    with open_hdf5(tmp_path / "a.h5") as file, pytest.raises(AsfmError, match="x is a link to another file or place"):
        read_array("a.h5", file, "x", (1,))
