"""Readers: one file a format, and the writer of the native folder."""

from collections.abc import Callable
from pathlib import Path

from asfm.datasets.aris.reader import is_aris, read_aris
from asfm.datasets.holoocean.reader import is_holoocean, read_holoocean
from asfm.datasets.native.reader import is_native, open_native_truth, read_native
from asfm.datasets.oculus.reader import is_oculus, read_oculus
from asfm.errors import AsfmError
from asfm.sequence import Sequence
from asfm.types import FrameTruth

__all__ = ["open_sequence", "open_truth"]

FORMATS: tuple[tuple[str, Callable[[Path], bool], Callable[[Path], Sequence]], ...] = (
    ("a native folder with sequence.yaml", is_native, read_native),
    ("a HoloOcean folder with Config.json and Data/*.pkl", is_holoocean, read_holoocean),
    ("an ARIS recording (.aris)", is_aris, read_aris),
    ("an Oculus recording of raw messages (.raw)", is_oculus, read_oculus),
)
"""What each format looks like, how to recognise it, how to read it."""


def open_sequence(path: Path) -> Sequence:
    """Open a sequence of any format that is read, recognised by content and not by name.

    Raises:
        AsfmError: there is nothing at the path, or nothing that is read.
    """
    try:
        if not path.exists():
            raise AsfmError(f"{path}: expected a sequence, found nothing there")
        for _, recognises, read in FORMATS:
            if recognises(path):
                return read(path)
    except OSError as error:
        raise AsfmError(f"{path}: cannot read: {error.strerror} ({error.filename or path})") from None
    known = "; ".join(description for description, _, _ in FORMATS)
    raise AsfmError(f"{path}: expected one of the formats that are read ({known}), found none of them")


def open_truth(path: Path) -> Callable[[int], FrameTruth] | None:
    """Give a function that reads the truth of frame i of a simulated sequence, or None where there is none."""
    return open_native_truth(path) if is_native(path) else None
