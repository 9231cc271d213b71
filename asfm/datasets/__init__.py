"""Dataset readers, one sub-package per format, and the writer of the native sequence folder."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from asfm.datasets.aris.reader import is_aris, read_aris
from asfm.datasets.holoocean.reader import is_holoocean, read_holoocean
from asfm.datasets.native.reader import is_native, open_native_truth, read_native
from asfm.datasets.oculus.reader import is_oculus, read_oculus
from asfm.datasets.plausibility import check_plausibility
from asfm.errors import AsfmError
from asfm.file_kinds import SNIFFED_BYTES, name_kind
from asfm.regular_file import check_file, is_regular, open_file
from asfm.sequence import Sequence
from asfm.types import FrameTruth

__all__ = ["open_sequence", "open_truth"]

FORMATS: tuple[tuple[str, Callable[[Path], bool], Callable[[Path], Sequence]], ...] = (
    ("a native folder with sequence.yaml", is_native, read_native),
    ("a HoloOcean folder with Config.json and Data/*.pkl", is_holoocean, read_holoocean),
    ("an ARIS recording (.aris)", is_aris, read_aris),
    ("an Oculus recording of raw messages (.raw)", is_oculus, read_oculus),
)
"""Description, recogniser and reader of each format."""


def open_sequence(path: Path) -> Sequence:
    """Open a sequence of any supported format; the format is recognised by content, not by file name.

    Args:
        path: folder or file of the recording.

    Returns:
        The sequence; its images are read on demand. Its diagnostics tell what the reader worked around and which
        values are implausible.

    Raises:
        AsfmError: the path does not exist, cannot be read, is of no supported format, is damaged or holds values
            that cannot be.
    """
    try:
        if not path.is_dir():
            check_file(path, "a sequence")
        for _, is_format, read in FORMATS:
            if is_format(path):
                return _make_printable(check_plausibility(path, read(path)))
        kind = _name_kind(path)
    except OSError as error:
        raise AsfmError(f"{path}: cannot read: {error.strerror} ({error.filename or path})") from None
    formats = "; ".join(description for description, _, _ in FORMATS)
    raise AsfmError(f"{path}: expected one of the formats that are read ({formats}), found {kind or 'none of them'}")


def _make_printable(sequence: Sequence) -> Sequence:
    """Escape the letters of a name that comes from a file name and is not UTF-8: no output file could hold them."""
    return replace(sequence, name=sequence.name.encode(errors="backslashreplace").decode())


def _name_kind(path: Path) -> str | None:
    if not is_regular(path):
        return None
    with open_file(path, "a sequence") as file:
        return name_kind(file.read(SNIFFED_BYTES))


def open_truth(path: Path) -> Callable[[int], FrameTruth] | None:
    """Return a function that reads the true elevation and clean image of frame i, or None where none are stored.

    Raises:
        AsfmError: the native folder around the truth cannot be read.
    """
    return open_native_truth(path) if is_native(path) else None
