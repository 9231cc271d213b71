"""Atomic creation of output folders: written under a temporary name, renamed when complete."""

import errno
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from asfm.errors import AsfmError
from asfm.folder_lock import find_temporaries, lock_folder, name_temporary, remove_leftovers

FULL_DISK = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO})
"""Error numbers of a disk that accepts no more data; such an error does not always name its file."""


def _tell_nobody(folder: Path) -> None:
    """Ignore a temporary folder."""


announce: Callable[[Path], None] = _tell_nobody
"""Called with every temporary folder before it is made; a supervised process tells its parent, which removes it."""


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
    unchanged. A killed process leaves ``<name>.<host>-<process>-<random>.partial``, never an incomplete ``path``; the
    next output to ``path`` removes it, as its lock tells that its process is dead.

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
    _clean_up(path)
    _require_replaceable(path, kind, overwrite)
    with ExitStack() as locks:
        partial = name_temporary(path, "partial")
        try:
            _make_folder(path, partial, locks)
            yield partial
        except BaseException as error:
            remove_partial(partial)
            if isinstance(error, OSError) and _is_write_error(error, partial):
                raise AsfmError(f"{path}: cannot write: {error.strerror}") from None
            raise
        _finish(path, partial, kind, overwrite)


def remove_partial(partial: Path) -> None:
    """Remove a temporary folder whose content will not be completed."""
    shutil.rmtree(partial, ignore_errors=True)


def _clean_up(path: Path) -> None:
    """Undo what killed processes left: restore a folder that was renamed aside, then remove temporary folders."""
    for old in find_temporaries(path, "old"):
        with lock_folder(old) as locked, suppress(OSError):
            if locked and not path.exists():
                old.rename(path)
    remove_leftovers(path, "old")
    remove_leftovers(path, "partial")


def _make_folder(path: Path, partial: Path, locks: ExitStack) -> None:
    try:
        announce(partial)
        partial.mkdir(parents=True)
    except OSError as error:
        raise AsfmError(f"{path}: cannot make a folder in {path.parent}: {error.strerror}") from None
    locks.enter_context(lock_folder(partial))
    if not partial.is_dir():  # another process took it for a leftover in the moment before it was locked
        partial.mkdir(parents=True)
        locks.enter_context(lock_folder(partial))


def _finish(path: Path, partial: Path, kind: FolderKind, overwrite: bool) -> None:
    """Move the complete folder into place; where that is impossible it stays under its temporary name."""
    try:
        _require_replaceable(path, kind, overwrite)  # again: the folder may have changed since
        _move_into_place(path, partial)
    except (AsfmError, OSError) as error:
        if not partial.is_dir():
            raise AsfmError(f"{path}: cannot write: {partial.name} was removed while it was written") from None
        raise AsfmError(f"{error}; the complete output is in {_keep(partial)}") from None
    except BaseException:
        remove_partial(partial)
        raise


def _keep(partial: Path) -> Path:
    """Rename a complete folder so that no later run takes it for a leftover."""
    kept = partial.with_suffix(".complete")
    try:
        return partial.rename(kept)
    except OSError:
        return partial


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
    old = name_temporary(path, "old")
    with lock_folder(path):
        try:
            if path.exists():
                path.rename(old)
            partial.rename(path)
        except BaseException:
            if old.exists() and not path.exists():
                old.rename(path)
            raise
        finally:
            if path.exists():
                shutil.rmtree(old, ignore_errors=True)
