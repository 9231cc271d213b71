"""A folder that appears all at once: written beside its place, moved there when it is whole."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from asfm.errors import AsfmError


@contextmanager
def staged_folder(folder: Path, overwrite: bool, marker: str) -> Iterator[Path]:
    """Give a temporary sibling folder to write into; rename it to ``folder`` on success, remove it on failure.

    Args:
        folder: where the result belongs; its parents are made.
        overwrite: replace a folder that is there, provided that it holds ``marker``.
        marker: name of the file that tells a folder that asfm wrote from anybody else's.

    Raises:
        AsfmError: the place is taken and may not be replaced, or the disk refuses.
    """
    folder = folder.resolve()
    _check_place(folder, overwrite, marker)
    partial = folder.with_name(f".{folder.name}.partial-{os.getpid()}")
    try:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        yield partial
        _swap(partial, folder)
    except OSError as error:
        raise AsfmError(f"{folder}: cannot write: {error.strerror or error} ({error.filename or folder})") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _check_place(folder: Path, overwrite: bool, marker: str) -> None:
    if not folder.exists():
        return
    if not folder.is_dir():
        raise AsfmError(f"{folder}: expected a folder or nothing, found a file: choose another name")
    if not any(folder.iterdir()):
        return
    if not overwrite:
        raise AsfmError(f"{folder}: expected an empty place, found a folder with files: choose another or overwrite it")
    if not (folder / marker).is_file():
        raise AsfmError(f"{folder}: expected to overwrite a folder with {marker}, found none in it: remove it yourself")


def _swap(partial: Path, folder: Path) -> None:
    if not folder.exists():
        partial.rename(folder)
        return
    previous = folder.with_name(f".{folder.name}.previous-{os.getpid()}")
    folder.rename(previous)
    try:
        partial.rename(folder)
    except OSError:
        previous.rename(folder)
        raise
    shutil.rmtree(previous)
