"""Atomic creation of output folders: written under a temporary name, renamed when complete."""

import errno
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from asfm.errors import AsfmError

FULL_DISK = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO})
"""Error numbers of a disk that accepts no more data; such an error does not always name its file."""


@dataclass(frozen=True)
class FolderKind:
    """The files of one kind of output folder; only a folder that matches is ever replaced."""

    name: str
    """For messages, as in "already holds ...": results, a sequence."""
    marks: tuple[str, ...]
    """Files that must all exist for the folder to be of this kind."""
    patterns: tuple[str, ...]
    """All files it may hold, as relative paths with / and wildcards; a folder with any other file is not replaced."""

    def find_foreign_entry(self, folder: Path) -> str | None:
        """Return the first entry of a folder, by name, that matches no pattern, or None."""
        names = sorted(entry.relative_to(folder).as_posix() for entry in folder.rglob("*"))
        known = (*self.patterns, ".DS_Store", "*/.DS_Store")
        return next((name for name in names if not any(fnmatch(name, pattern) for pattern in known)), None)


@contextmanager
def atomic_folder(path: Path, kind: FolderKind, overwrite: bool) -> Iterator[Path]:
    """Yield a temporary folder that is renamed to ``path`` when the body ends without an exception.

    When the body raises, KeyboardInterrupt included, the temporary folder is removed and an existing ``path`` is left
    unchanged. A killed process leaves ``<name>.<random>.partial``, never an incomplete ``path``.

    Args:
        path: the final folder; its parents are created.
        kind: the files it will hold; an existing folder must match it to be replaced.
        overwrite: replace an existing folder.

    Yields:
        The temporary folder, in the same parent folder.

    Raises:
        AsfmError: ``path`` holds other files, a folder cannot be created or renamed, or the disk is full.
    """
    path = path.resolve()
    _require_replaceable(path, kind, overwrite)
    partial = _temporary_name(path, "partial")
    try:
        partial.mkdir(parents=True)
    except OSError as error:
        raise AsfmError(f"{path}: cannot make a folder in {path.parent}: {error.strerror}") from None
    try:
        yield partial
    except BaseException as error:
        shutil.rmtree(partial, ignore_errors=True)
        if isinstance(error, OSError) and _is_write_error(error, partial):
            raise AsfmError(f"{path}: cannot write: {error.strerror}") from None
        raise
    try:
        _require_replaceable(path, kind, overwrite)  # again: the folder may have changed since
        _move_into_place(path, partial)
    except (AsfmError, OSError) as error:
        raise AsfmError(f"{error}; the complete output is in {partial}") from None


def _require_replaceable(path: Path, kind: FolderKind, overwrite: bool) -> None:
    try:
        if not path.exists():
            return
        if not path.is_dir():
            raise AsfmError(f"{path}: expected a folder or nothing, found a file: choose another name")
        if os.path.ismount(path) or Path.cwd().is_relative_to(path):
            raise AsfmError(f"{path}: cannot replace a mount point or the working directory: name a folder inside it")
        if not any(path.iterdir()):
            return
        if not all((path / mark).is_file() for mark in kind.marks):
            raise AsfmError(f"{path}: expected an empty place, found {_first_entry(path)}: choose another folder")
        if not overwrite:
            raise AsfmError(f"{path}: already holds {kind.name}: choose another folder, or overwrite it (--overwrite)")
        foreign = kind.find_foreign_entry(path)
    except OSError as error:
        raise AsfmError(f"{path}: cannot look into it: {error.strerror}") from None
    if foreign is not None:
        raise AsfmError(f"{path}: holds {foreign}, which asfm did not write: move it or choose another folder")


def _first_entry(folder: Path) -> str:
    return min(entry.name for entry in folder.iterdir())


def _is_write_error(error: OSError, partial: Path) -> bool:
    """Return whether an error concerns the output folder; any other, such as a broken pipe, is passed on."""
    named = error.filename if isinstance(error.filename, str | os.PathLike) else None
    return error.errno in FULL_DISK or (named is not None and Path(named).is_relative_to(partial))


def _move_into_place(path: Path, partial: Path) -> None:
    """Rename the old folder aside and the new one into place, then delete the old one; restore it on failure."""
    old = _temporary_name(path, "old")
    try:
        if path.exists():
            path.rename(old)
        partial.rename(path)
    except BaseException:
        if old.exists() and not path.exists():
            old.rename(path)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _temporary_name(path: Path, suffix: str) -> Path:
    return path.with_name(f"{path.name}.{secrets.token_hex(4)}.{suffix}")
