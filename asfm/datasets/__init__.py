"""Readers: one file a format, and the writer of the native folder."""

from collections.abc import Callable
from pathlib import Path

from asfm.datasets.native import read_native
from asfm.errors import AsfmError
from asfm.sequence import Sequence

__all__ = ["open_sequence"]


def _is_native(path: Path) -> bool:
    return (path / "sequence.yaml").is_file()


FORMATS: tuple[tuple[str, Callable[[Path], bool], Callable[[Path], Sequence]], ...] = (
    ("a native folder with sequence.yaml", _is_native, read_native),
)
"""What each format looks like, how to recognise it, how to read it."""


def open_sequence(path: Path) -> Sequence:
    """Open a sequence of any format that is read, recognised by content and not by name.

    Raises:
        AsfmError: there is nothing at the path, or nothing that is read.
    """
    if not path.exists():
        raise AsfmError(f"{path}: expected a sequence, found nothing there")
    for _, recognises, read in FORMATS:
        if recognises(path):
            return read(path)
    known = "; ".join(description for description, _, _ in FORMATS)
    raise AsfmError(f"{path}: expected one of the formats that are read ({known}), found none of them")
