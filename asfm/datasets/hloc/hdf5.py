"""Validated reading of HDF5 files from other programs: groups and arrays of finite numbers."""

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from asfm.errors import AsfmError, quote, shorten
from asfm.file_kinds import HDF5_KIND, SNIFFED_BYTES, name_kind
from asfm.regular_file import open_file

MAX_ARRAY_SIZE = 1 << 24
"""Numbers in one array: a small file may claim an array of any size."""
MAX_VALUE = 1e30
MAX_COMPRESSION = 200
"""Bytes of an array, or of one of its chunks, over those that are stored; keypoints and matches reach a tenth."""
SMALL_BYTES = 1 << 20
"""Arrays up to this size are read whatever is stored: parts that were never written are filled."""
DAMAGE = (OSError, RuntimeError, KeyError, ValueError, TypeError, OverflowError)
"""Exceptions of h5py on damaged files."""


@contextmanager
def open_hdf5(path: Path, mode: Literal["r", "w"] = "r") -> Iterator[Any]:
    """Open an HDF5 file as a context manager that yields an ``h5py.File``.

    Raises:
        AsfmError: the file is missing, not HDF5 or damaged, or cannot be written; also where the block fails to read.
    """
    import h5py

    damage = DAMAGE if mode == "r" else (OSError, RuntimeError)
    if mode == "r":
        with open_file(path, "an HDF5 file") as file:
            kind = name_kind(file.read(SNIFFED_BYTES))
        if kind not in (None, HDF5_KIND):
            raise AsfmError(f"{path}: expected an HDF5 file, found {kind}")
    try:
        with h5py.File(path, mode) as file:
            yield file
    except damage as error:
        action = "write" if mode == "w" else "read as HDF5"
        raise AsfmError(f"{path}: cannot {action}: {shorten(_reason(error), 160)}") from None


def _reason(error: Exception) -> str:
    """Return the system's reason where HDF5 quotes one among its own state, else its words."""
    text = " ".join(str(error).split())
    reason = re.search(r"error message = '([^']*)'", text)
    return reason.group(1) if reason else text


def find_groups(path: Path, file: Any, array: str) -> list[tuple[str, Any]]:
    """Find all groups at any depth that hold an array of a given name; links are not followed.

    Args:
        path: the file, for messages.
        file: open ``h5py.File``.
        array: name of the array.

    Returns:
        The full name and the group of each.

    Raises:
        AsfmError: there is none.
    """
    import h5py

    found: list[tuple[str, Any]] = []

    def collect(name: str | bytes, item: Any) -> None:
        if isinstance(name, bytes):
            raise AsfmError(f"{path}: expected names in UTF-8, found {quote(name)}")
        if isinstance(item, h5py.Group) and array in item:
            found.append((name, item))

    file.visititems(collect)
    if not found:
        raise AsfmError(f"{path}: expected groups that hold {array!r}, found none")
    return found


def read_array(where: str, group: Any, name: str, shape: tuple[int | None, ...]) -> NDArray[Any]:
    """Read an array of finite numbers.

    Args:
        where: the file and the group, for messages.
        group: ``h5py.Group`` that holds the array.
        name: name of the array.
        shape: expected length of each axis, None for any.

    Returns:
        The array, with the numbers' own type.

    Raises:
        AsfmError: it is no array of numbers, has another shape, is not finite, or is stored in another file.
    """
    import h5py

    data = group[name]
    if not isinstance(data, h5py.Dataset) or data.dtype.kind not in "fiu":
        kind = shorten(str(data.dtype)) if isinstance(data, h5py.Dataset) else "a group"
        raise AsfmError(f"{where}: expected numbers in {name}, found {kind}")
    if data.external or data.is_virtual or group.get(name, getlink=True).__class__ is not h5py.HardLink:
        raise AsfmError(f"{where}: {name} is a link to another file or place: copy the array itself")
    if data.shape is None:
        raise AsfmError(f"{where}: expected numbers in {name}, found an empty (null) dataspace")
    expected = [length if length is not None else "any" for length in shape]
    has_shape = len(data.shape) == len(shape) and all(
        length in (None, found) for length, found in zip(shape, data.shape, strict=True)
    )
    if not has_shape or data.size > MAX_ARRAY_SIZE:
        raise AsfmError(f"{where}: expected {name} of the shape {expected}, found {quote(list(data.shape))}")
    _check_storage(where, name, data)
    values = np.asarray(data[()])
    if values.dtype.kind == "f" and not (np.abs(values) <= min(MAX_VALUE, float(np.finfo(values.dtype).max))).all():
        row = int(np.argwhere(~(np.abs(values) <= MAX_VALUE))[0][0]) if values.ndim else 0
        found = f"NaN, infinity or more than {MAX_VALUE:g}, the first in row {row}"
        raise AsfmError(f"{where}: expected finite numbers in {name}, found {found}")
    return values


def _check_storage(where: str, name: str, data: Any) -> None:
    """Check that an array, or a chunk of it, is not far larger than what is stored of it."""
    stored = int(data.id.get_storage_size())
    chunk = math.prod(data.chunks or ()) * data.dtype.itemsize
    for what, size in ((name, data.nbytes), (f"a chunk of {name}", chunk)):
        if size > SMALL_BYTES and size > MAX_COMPRESSION * stored:
            raise AsfmError(
                f"{where}: expected {what} stored in the file, found {size} bytes of which {stored} are stored: "
                "write it again, without compression"
            )
