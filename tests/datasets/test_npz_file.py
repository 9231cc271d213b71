"""NumPy archives: read back, and refused before anything is allocated where the header or the archive lies."""

import io
import zipfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asfm.datasets.npz_file import read_arrays
from asfm.errors import AsfmError


def pack(path: Path, **members: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return path


def header(shape: str, descr: str = "'<f8'") -> bytes:
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


@pytest.mark.parametrize("dtype", ["f4", "f8", "u1", ">u2"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_are_read_back(tmp_path: Path, dtype: str, order: Any) -> None:
    values = np.asarray(np.arange(6).reshape(2, 3), dtype=dtype, order=order)
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "a.npz", x=values, y=values + 1)
        x, y = read_arrays(tmp_path / "a.npz", ("x", "y"), (2, 3), "arrays")
        np.testing.assert_array_equal(x, values)
        np.testing.assert_array_equal(y, values + 1)


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (header("(2, 99999999999)") + bytes(48), "of shape"),
        (header("(2, 3)") + bytes(40), "expected 48 bytes of x, found another number"),
        (header("(2, 3)") + bytes(10_000), "expected 48 bytes of x, found another number"),
        (header("(2, 3)", "'|O'") + bytes(48), "to hold numbers, found object"),
        (header("(2, 3)", "'<c16'") + bytes(96), "to hold numbers, found complex128"),
        (header("(2, " * 400), "found: "),
        (header("__import__('os')"), "found: "),
        (b"no array", "found: "),
        (b"", "found: "),
    ],
)
def test_members_that_lie_are_refused(tmp_path: Path, content: bytes, found: str) -> None:
    with pytest.raises(AsfmError, match=rf"a\.npz: .*{found}"):
        read_arrays(pack(tmp_path / "a.npz", x=content), ("x",), (2, 3), "arrays")


def test_archives_that_are_damaged_are_refused(tmp_path: Path) -> None:
    file = io.BytesIO()
    np.savez_compressed(file, x=np.random.default_rng(0).random((2, 3)))
    content = file.getvalue()
    for place in range(0, len(content), 7):
        (tmp_path / "a.npz").write_bytes(content[:place] + bytes([content[place] ^ 0xFF]) + content[place + 1 :])
        with suppress(AsfmError):  # and nothing else
            assert read_arrays(tmp_path / "a.npz", ("x",), (2, 3), "arrays")[0].shape == (2, 3)
    with pytest.raises(AsfmError, match=r"a\.npz: expected arrays, found none"):
        (tmp_path / "a.npz").unlink()
        read_arrays(tmp_path / "a.npz", ("x",), (2, 3), "arrays")


def test_a_header_of_python_2_is_read_without_a_warning(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    path = pack(tmp_path / "a.npz", x=header("(2L, 3L)") + np.arange(6.0).tobytes())
    np.testing.assert_array_equal(read_arrays(path, ("x",), (2, 3), "arrays")[0], np.arange(6.0).reshape(2, 3))
    assert len(recwarn) == 0


def test_a_damaged_number_in_a_header_is_refused_without_a_warning(
    tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    path = pack(tmp_path / "a.npz", x=header("(2or 3, 3)") + np.arange(6.0).tobytes())
    with suppress(AsfmError):
        read_arrays(path, ("x",), (2, 3), "arrays")
    assert len(recwarn) == 0
