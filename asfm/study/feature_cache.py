"""Cache of what several cells share, addressed by content: each entry is made once, whatever the processes do."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from asfm.atomic_folder import FolderKind, atomic_folder
from asfm.errors import AsfmError

ENTRY = FolderKind("an entry of the cache", marks=(), patterns=("*",))


@dataclass(frozen=True)
class StudyCache:
    """Entries below a folder, each a folder of its own: kind/key."""

    folder: Path

    def provide(self, kind: str, key: str, make: Callable[[Path], None]) -> Path:
        """Return the folder of an entry, which is made first where it is missing.

        An entry is written aside and renamed. Another process that needs the same one waits until it is there.

        Args:
            kind: of the entry, such as "features".
            key: fingerprint of all that the entry depends on.
            make: fills an empty folder; its exceptions are passed on, and nothing is kept.

        Raises:
            AsfmError: the entry cannot be written.
        """
        path = self.folder / kind / key
        if path.is_dir():
            return path
        with _wait_for_lock(path.with_suffix(".lock")):
            if not path.is_dir():
                with atomic_folder(path, ENTRY, overwrite=False) as partial:
                    make(partial)
        return path


@contextmanager
def _wait_for_lock(path: Path) -> Iterator[None]:
    """Hold the lock of a file, which the system frees when the process dies; systems without such locks go on."""
    try:
        import fcntl
    except ImportError:  # Windows: an entry may be made twice, and the second is dropped
        yield
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("wb")
    except OSError as error:
        raise AsfmError(f"{path}: cannot write: {error.strerror}") from None
    with file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
