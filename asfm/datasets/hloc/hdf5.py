"""HDF5 files of strangers: groups and arrays of numbers, and one clear line for what is wrong."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from asfm.errors import AsfmError

LARGEST = 1 << 28
"""Numbers in one array: a file of some bytes may claim to hold any number."""


@contextmanager
def open_hdf5(path: Path, mode: Literal["r", "w"] = "r") -> Iterator[Any]:
    """Open a file for the length of a block.

    Raises:
        AsfmError: it is not there, not HDF5, or breaks off.
    """
    import h5py

    if mode == "r" and not path.is_file():
        raise AsfmError(f"{path}: expected an HDF5 file, found {'a folder' if path.is_dir() else 'nothing there'}")
    try:
        with h5py.File(path, mode) as file:
            yield file
    except (OSError, RuntimeError, KeyError) as error:
        what = "write" if mode == "w" else "read as HDF5"
        raise AsfmError(f"{path}: cannot {what}: {' '.join(str(error).split())}") from None


def walk_groups(path: Path, file: Any, array: str) -> list[tuple[str, Any]]:
    """List all groups that hold a certain array, however deep, with their full names; links are not followed.

    Raises:
        AsfmError: there is none.
    """
    import h5py

    found: list[tuple[str, Any]] = []

    def look_at(name: str, thing: Any) -> None:
        if isinstance(thing, h5py.Group) and array in thing:
            found.append((name, thing))

    file.visititems(look_at)
    if not found:
        raise AsfmError(f"{path}: expected groups that hold {array!r}, found none")
    return found


def read_array(where: str, group: Any, name: str, shape: tuple[int | None, ...]) -> NDArray[Any]:
    """Read an array of finite numbers of a given shape, None standing for any length.

    Raises:
        AsfmError: it is something else, or its numbers lie in another file.
    """
    import h5py

    data = group[name]
    if not isinstance(data, h5py.Dataset) or data.dtype.kind not in "fiu":
        kind = data.dtype if isinstance(data, h5py.Dataset) else "a group"
        raise AsfmError(f"{where}: expected numbers in {name}, found {kind}")
    if data.external or data.is_virtual or group.get(name, getlink=True).__class__ is not h5py.HardLink:
        raise AsfmError(f"{where}: {name} lies in another file: copy it into this one")
    expected = [length if length is not None else "any" for length in shape]
    fits = len(data.shape) == len(shape) and all(
        length in (None, found) for length, found in zip(shape, data.shape, strict=True)
    )
    if not fits or data.size > LARGEST:
        raise AsfmError(f"{where}: expected {name} of the shape {expected}, found {list(data.shape)}")
    values = np.asarray(data[()])
    if not np.isfinite(values).all():
        row = int(np.argwhere(~np.isfinite(values))[0][0])
        raise AsfmError(f"{where}: expected finite numbers in {name}, found others, the first in row {row}")
    return values
