"""A folder that appears all at once: written beside its place, moved there when it is whole."""

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
"""What a disk answers that takes no more; such an error does not always name its file."""


@dataclass(frozen=True)
class FolderKind:
    """What a folder of one kind looks like when asfm wrote it: only such a folder is ever replaced."""

    name: str
    """As in "already holds ...": results, a sequence."""
    marks: tuple[str, ...]
    """Files that together tell it from anybody else's."""
    patterns: tuple[str, ...]
    """All that it may hold, relative and with / between parts; a stranger's file in it is never deleted."""

    def find_stranger(self, folder: Path) -> str | None:
        """Give the first entry of a folder that matches no pattern, or None."""
        names = sorted(entry.relative_to(folder).as_posix() for entry in folder.rglob("*"))
        known = (*self.patterns, ".DS_Store", "*/.DS_Store")
        return next((name for name in names if not any(fnmatch(name, pattern) for pattern in known)), None)


@contextmanager
def atomic_folder(path: Path, kind: FolderKind, overwrite: bool) -> Iterator[Path]:
    """Yield a temporary folder beside ``path`` that takes its place when the body ends without an exception.

    When the body raises, KeyboardInterrupt included, the temporary folder is removed and an existing ``path`` stays as
    it was. A process killed outright leaves ``<name>.<random>.partial``, never a half-written ``path``.

    Args:
        path: where the folder belongs; its parents are made.
        kind: what it will hold, and what a folder that is there must look like to be replaced.
        overwrite: replace one that is there.

    Raises:
        AsfmError: ``path`` is not ours to replace, a folder cannot be made or renamed, or the disk is full.
    """
    path = path.resolve()
    _require_place(path, kind, overwrite)
    partial = _name_beside(path, "partial")
    try:
        partial.mkdir(parents=True)
    except OSError as error:
        raise AsfmError(f"{path}: cannot make a folder in {path.parent}: {error.strerror}") from None
    try:
        yield partial
    except BaseException as error:
        shutil.rmtree(partial, ignore_errors=True)
        if isinstance(error, OSError) and _refuses_writing(error, partial):
            raise AsfmError(f"{path}: cannot write: {error.strerror}") from None
        raise
    try:
        _require_place(path, kind, overwrite)  # again: much may have happened meanwhile
        _take_place(path, partial)
    except (AsfmError, OSError) as error:
        raise AsfmError(f"{error}; what was made is whole in {partial}") from None


def _require_place(path: Path, kind: FolderKind, overwrite: bool) -> None:
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
            raise AsfmError(f"{path}: expected an empty place, found {_first_of(path)}: choose another folder")
        if not overwrite:
            raise AsfmError(f"{path}: already holds {kind.name}: choose another folder, or overwrite it (--overwrite)")
        stranger = kind.find_stranger(path)
    except OSError as error:
        raise AsfmError(f"{path}: cannot look into it: {error.strerror}") from None
    if stranger is not None:
        raise AsfmError(f"{path}: holds {stranger}, which asfm did not write: move it or choose another folder")


def _first_of(folder: Path) -> str:
    return min(entry.name for entry in folder.iterdir())


def _refuses_writing(error: OSError, partial: Path) -> bool:
    """Tell whether an error is about what we write; any other, a broken pipe say, is not ours to explain."""
    named = error.filename if isinstance(error.filename, str | os.PathLike) else None
    return error.errno in FULL_DISK or (named is not None and Path(named).is_relative_to(partial))


def _take_place(path: Path, partial: Path) -> None:
    """Rename the old folder aside, the new one in, and delete the old one; on failure put the old one back."""
    old = _name_beside(path, "old")
    try:
        if path.exists():
            path.rename(old)
        partial.rename(path)
    except BaseException:
        if old.exists() and not path.exists():
            old.rename(path)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _name_beside(path: Path, suffix: str) -> Path:
    return path.with_name(f"{path.name}.{secrets.token_hex(4)}.{suffix}")
