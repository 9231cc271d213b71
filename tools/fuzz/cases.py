"""Single fuzz cases: a damaged file is written and read, and the outcome is judged."""

import resource
import signal
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asfm.errors import AsfmError
from tools.fuzz.mutation import mutate

SECONDS, MAX_MESSAGE = 2.0, 700
"""Processor time that one case may take, and characters of a message."""
LOADED, REFUSED = "loaded", "refused"


@dataclass(frozen=True)
class Target:
    """A file to mutate within a folder, and the function that reads it."""

    file: str
    make: Callable[[Path], None]
    """Writes the valid folder."""
    read: Callable[[Path], object]
    """Reads the folder; raises AsfmError where it refuses."""
    pack: Callable[[bytes], bytes] | None = None
    """Makes the file's content of the mutated bytes, such as checksums that fit; None where these are the content."""
    unpack: Callable[[bytes], bytes] | None = None
    """Takes the bytes to mutate from the valid content."""


def run_case(target: Target, folder: Path, valid: bytes, seed: tuple[int, int]) -> str:
    """Read one damaged file in a folder.

    Args:
        target: its file and reader.
        folder: a valid folder, whose file is overwritten.
        valid: the bytes of the file, or what :attr:`Target.unpack` makes of them.
        seed: seed of the run, and number of the case.

    Returns:
        LOADED, REFUSED, or what went wrong.
    """
    content = mutate(valid, np.random.default_rng(seed))
    (folder / target.file).write_bytes(content if target.pack is None else target.pack(content))
    try:
        with _limited_time(), warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            target.read(folder)
    except AsfmError as error:
        message = str(error)
        return REFUSED if message.isprintable() and len(message) <= MAX_MESSAGE else f"a long message: {message[:200]}"
    except (Exception, TimeoutError) as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}: {str(error)[:160]!r} at {Path(place.filename).name}:{place.lineno}"
    return LOADED


def limit_memory(more_bytes: int) -> None:
    """Let this process take so much address space more than it has; nothing is limited on systems without /proc."""
    status = Path("/proc/self/statm")
    if status.exists():
        limit = int(status.read_text(encoding="ascii").split()[0]) * resource.getpagesize() + more_bytes
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


@contextmanager
def _limited_time() -> Iterator[None]:
    """Raise TimeoutError after SECONDS of processor time, so that other programs do not count."""

    def stop(*_: object) -> None:
        raise TimeoutError(f"longer than {SECONDS:g} s")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
