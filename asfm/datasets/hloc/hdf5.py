"""Validated reading of HDF5 files from other programs: groups and arrays of finite numbers."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from asfm.errors import AsfmError

MAX_ARRAY_SIZE = 1 << 28
"""Numbers in one array: a small file may claim an array of any size."""


@contextmanager
def open_hdf5(path: Path, mode: Literal["r", "w"] = "r") -> Iterator[Any]:
    """Open an HDF5 file as a context manager that yields an ``h5py.File``.

    Raises:
        AsfmError: the file is missing, not HDF5 or damaged, or cannot be written; also where the block fails to read.
    """
    import h5py

    if mode == "r" and not path.is_file():
        raise AsfmError(f"{path}: expected an HDF5 file, found {'a folder' if path.is_dir() else 'nothing there'}")
    try:
        with h5py.File(path, mode) as file:
            yield file
    except (OSError, RuntimeError, KeyError) as error:
        action = "write" if mode == "w" else "read as HDF5"
        raise AsfmError(f"{path}: cannot {action}: {_shorten(error)}") from None


def _shorten(error: Exception) -> str:
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

    def collect(name: str, item: Any) -> None:
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
        kind = data.dtype if isinstance(data, h5py.Dataset) else "a group"
        raise AsfmError(f"{where}: expected numbers in {name}, found {kind}")
    if data.external or data.is_virtual or group.get(name, getlink=True).__class__ is not h5py.HardLink:
        raise AsfmError(f"{where}: {name} is a link to another file or place: copy the array itself")
    expected = [length if length is not None else "any" for length in shape]
    has_shape = len(data.shape) == len(shape) and all(
        length in (None, found) for length, found in zip(shape, data.shape, strict=True)
    )
    if not has_shape or data.size > MAX_ARRAY_SIZE:
        raise AsfmError(f"{where}: expected {name} of the shape {expected}, found {list(data.shape)}")
    values = np.asarray(data[()])
    if not np.isfinite(values).all():
        row = int(np.argwhere(~np.isfinite(values))[0][0])
        raise AsfmError(f"{where}: expected finite numbers in {name}, found NaN or infinity, the first in row {row}")
    return values
