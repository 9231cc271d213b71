"""NumPy archives (.npz) from untrusted sources: shape and type are checked before an array is allocated."""

import io
import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from asfm.errors import AsfmError, join_quoted, shorten
from asfm.regular_file import check_file, open_file

MAX_BYTES = 1 << 30
MAX_HEADER_BYTES = 4096
HEADER_READERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def read_arrays(path: Path, names: tuple[str, ...], shape: tuple[int, ...], expected: str) -> list[NDArray[Any]]:
    """Read arrays of floats or unsigned integers, each of a given shape.

    Args:
        path: the archive.
        names: names of the arrays.
        shape: shape that all of them must have.
        expected: what the file should be, for messages.

    Raises:
        AsfmError: the file is missing or damaged, or an array is missing, not numeric or of another shape.
    """
    check_file(path, expected, MAX_BYTES)
    try:
        with open_file(path, expected, MAX_BYTES) as file, zipfile.ZipFile(file) as archive:
            members = [name.removesuffix(".npy") for name in archive.namelist()]
            for name in names:
                if name not in members:
                    raise AsfmError(f"{path}: expected an array {name}, found {join_quoted(members) or 'none'}")
            return [_read_member(path, archive, name, shape) for name in names]
    except AsfmError:
        raise
    except Exception as error:  # a damaged archive raises almost anything
        found = shorten(str(error)) or type(error).__name__
        raise AsfmError(f"{path}: expected an .npz with {' and '.join(names)}, found: {found}") from None


def _read_member(path: Path, archive: zipfile.ZipFile, name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    with archive.open(f"{name}.npy") as member:
        file = io.BytesIO(member.read(MAX_HEADER_BYTES))
    dtype, is_fortran = _read_header(path, file, name, shape)
    size = int(np.prod(shape)) * dtype.itemsize
    with archive.open(f"{name}.npy") as member:
        content = member.read(file.tell() + size + 1)
    start = file.tell()
    if len(content) != start + size:
        raise AsfmError(f"{path}: expected {size} bytes of {name}, found another number: write it again")
    return np.frombuffer(content, dtype, offset=start).reshape(shape, order="F" if is_fortran else "C")


def _read_header(path: Path, file: io.BytesIO, name: str, shape: tuple[int, ...]) -> tuple[np.dtype[Any], bool]:
    """Return the type of the numbers and whether columns are contiguous, after a check of the shape."""
    version = npy.read_magic(file)
    if version not in HEADER_READERS:
        raise AsfmError(f"{path}: expected {name} in version 1 or 2 of NumPy's format, found {version[0]}")
    with warnings.catch_warnings():
        # NumPy warns of headers that Python 2 wrote, and reads them; Python warns of numbers in damaged ones.
        warnings.simplefilter("ignore")
        found, is_fortran, dtype = HEADER_READERS[version](file)
    if found != shape:
        raise AsfmError(f"{path}: expected {name} of shape {shape} (ranges, beams), found {shorten(str(found))}")
    if not (np.issubdtype(dtype, np.floating) or np.issubdtype(dtype, np.unsignedinteger)):
        raise AsfmError(f"{path}: expected {name} to hold numbers, found {shorten(str(dtype))}")
    return dtype, is_fortran
