"""Locks on temporary folders, which tell those of running processes from those that a killed process left behind."""

import hashlib
import os
import platform
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

HOST_LETTERS, RANDOM_LETTERS = 8, 8


@cache
def _host() -> str:
    """Return a short name of this host; only its own leftovers are ever removed: locks may not reach other hosts."""
    identity = platform.node().encode()
    for place in ("/etc/machine-id", "/proc/sys/kernel/random/boot_id"):
        try:
            return hashlib.sha256(identity + Path(place).read_bytes()).hexdigest()[:HOST_LETTERS]
        except OSError:
            continue
    return hashlib.sha256(identity).hexdigest()[:HOST_LETTERS]


def name_temporary(path: Path, suffix: str) -> Path:
    """Return ``<name>.<host>-<process>-<random>.<suffix>`` beside a path."""
    owner = f"{_host()}-{os.getpid()}-{secrets.token_hex(RANDOM_LETTERS // 2)}"
    return path.with_name(f"{path.name}.{owner}.{suffix}")


@contextmanager
def lock_folder(folder: Path) -> Iterator[bool]:
    """Hold a lock on a folder, under whatever name, until the body ends or the process dies.

    Yields:
        Whether the lock was had: False where another process holds it, the folder is gone or cannot be locked.
    """
    descriptor = _lock(folder)
    try:
        yield descriptor is not None
    finally:
        if descriptor is not None:
            os.close(descriptor)


def remove_leftovers(path: Path, suffix: str) -> None:
    """Remove the temporary folders of a path that processes of this host left when they were killed.

    Folders of running processes and of other hosts stay, and so does what cannot be removed.
    """
    for folder in find_temporaries(path, suffix):
        with lock_folder(folder) as locked:
            if locked:
                shutil.rmtree(folder, ignore_errors=True)


def find_temporaries(path: Path, suffix: str) -> list[Path]:
    """Return the temporary folders of a path that processes of this host have made, running or not, by name."""
    prefix = f"{path.name}.{_host()}-"
    try:
        beside = sorted(path.parent.iterdir())
    except OSError:
        return []
    return [
        folder
        for folder in beside
        if folder.name.startswith(prefix)
        and _is_owner(folder.name.removeprefix(prefix), suffix)
        and folder.is_dir()
        and not folder.is_symlink()
    ]


def _is_owner(text: str, suffix: str) -> bool:
    """Return whether the end of a name is ``<process>-<random>.<suffix>``."""
    process, _, rest = text.partition("-")
    word, _, end = rest.partition(".")
    return process.isdecimal() and len(word) == RANDOM_LETTERS and end == suffix


def _lock(folder: Path) -> int | None:
    """Lock a folder for this process.

    Returns:
        The descriptor that holds the lock, or None.
    """
    try:
        import fcntl
    except ImportError:  # Windows: nothing is locked and nothing is cleaned up
        return None
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(descriptor), os.stat(folder)):  # noqa: PTH116 - else it was renamed meanwhile
            return descriptor
    except OSError:
        pass
    os.close(descriptor)
    return None
