"""Regular input files: checked for kind, size and place before they are opened, and read in one piece."""

import os
import stat
from pathlib import Path
from typing import BinaryIO

from asfm.errors import AsfmError, quote
from asfm.file_kinds import SNIFFED_BYTES, name_kind

MAX_TEXT_BYTES = 512 << 20
"""Tables of an hour at a kilohertz are smaller."""
MAX_BINARY_BYTES = 1 << 30
"""One image, pickle or mesh."""
SPECIAL_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe (FIFO)"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def is_present(path: Path) -> bool:
    """Return whether anything is at a path: a link that leads nowhere is there too, for its reader to refuse."""
    try:
        return os.path.lexists(path)
    except ValueError:  # a NUL byte in the name
        return False


def is_regular(path: Path) -> bool:
    """Return whether a regular file is at a path, links followed."""
    try:
        return path.is_file()
    except OSError:
        return False


def check_file(path: Path, expected: str, max_bytes: int | None = None) -> int:
    """Check that a path is a regular file of sane size, without opening it.

    Args:
        path: the file; links are followed.
        expected: what should be there, for messages, such as "a grey PNG image".
        max_bytes: largest size; None where the file is never read in one piece.

    Returns:
        The size in bytes.

    Raises:
        AsfmError: nothing is there, a link leads nowhere, or it is a folder, a pipe, a device or too large.
    """
    try:
        return _check_status(path, path.stat(), expected, max_bytes)
    except (OSError, ValueError) as error:
        raise AsfmError(f"{path}: expected {expected}, found {_explain(path, error)}") from None


def open_file(path: Path, expected: str, max_bytes: int | None = None) -> BinaryIO:
    """Open a regular file to read its bytes; arguments as for :func:`check_file`.

    Raises:
        AsfmError: as for :func:`check_file`.
    """
    check_file(path, expected, max_bytes)
    try:
        # Not blocking: a pipe that took the file's place since must not stop the program.
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        file = os.fdopen(descriptor, "rb")
    except OSError as error:
        raise AsfmError(f"{path}: expected {expected}, found {_explain(path, error)}") from None
    try:
        _check_status(path, os.fstat(descriptor), expected, max_bytes)
    except AsfmError:
        file.close()
        raise
    return file


def read_file(path: Path, expected: str, max_bytes: int = MAX_BINARY_BYTES) -> bytes:
    """Read a whole regular file; arguments as for :func:`check_file`.

    Raises:
        AsfmError: as for :func:`check_file`.
    """
    with open_file(path, expected, max_bytes) as file:
        try:
            size = os.fstat(file.fileno()).st_size
            content = file.read(size + 1)  # not max_bytes: Python takes the memory for all that may be read
        except OSError as error:
            raise AsfmError(f"{path}: expected {expected}, found {_explain(path, error)}") from None
    if len(content) > size:
        raise AsfmError(f"{path}: expected {expected}, found a file that grows while it is read")
    return content


def read_text(path: Path, expected: str, max_bytes: int = MAX_TEXT_BYTES) -> str:
    """Read a regular file of UTF-8 text, a byte-order mark left out; arguments as for :func:`check_file`.

    Raises:
        AsfmError: as for :func:`check_file`, or it is no UTF-8; the message names the kind of file that it is.
    """
    content = read_file(path, expected, max_bytes)
    kind = name_kind(content[:SNIFFED_BYTES]) if content else None
    if kind is not None:
        raise AsfmError(f"{path}: expected {expected}, found {kind}")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        found = f"the byte {content[error.start]:#04x} at {error.start}, which is no UTF-8"
        raise AsfmError(f"{path}: expected {expected} in UTF-8, found {found}: save it as UTF-8 text") from None
    position = text.find("\0")
    if position >= 0:
        line = text.count("\n", 0, position) + 1
        raise AsfmError(f"{path}, line {line}: expected {expected} in UTF-8, found a NUL byte: save it as UTF-8 text")
    return text


def check_inside(folder: Path, path: Path, expected: str) -> None:
    """Check that a path stays in a folder when links are followed, so that no other file can be read through it.

    Raises:
        AsfmError: it leads outside.
    """
    try:
        root, place = os.path.realpath(folder), os.path.realpath(path)
    except (OSError, ValueError) as error:
        raise AsfmError(f"{path}: expected {expected}, found {_explain(path, error)}") from None
    if place != root and not place.startswith(root.rstrip(os.sep) + os.sep):
        raise AsfmError(
            f"{path}: expected {expected} in the folder {folder}, found a path that leads outside, to "
            f"{quote(place)}: copy the file into the folder"
        )


def _check_status(path: Path, status: os.stat_result, expected: str, max_bytes: int | None) -> int:
    if not stat.S_ISREG(status.st_mode):
        kind = next((name for is_kind, name in SPECIAL_KINDS if is_kind(status.st_mode)), "no regular file")
        raise AsfmError(f"{path}: expected {expected}, found {kind}")
    if max_bytes is not None and status.st_size > max_bytes:
        raise AsfmError(f"{path}: expected {expected} of {max_bytes} bytes at most, found {status.st_size}")
    return status.st_size


def _explain(path: Path, error: OSError | ValueError) -> str:
    """Say what is at a path that cannot be opened."""
    if isinstance(error, ValueError):  # a NUL byte, or a letter that no file name can hold
        return "a name that no file can have"
    try:
        if path.is_symlink() and not path.exists():
            return f"a link to {quote(str(path.readlink()))}, which is missing: mend the link or remove it"
    except OSError:
        return f"none: {error.strerror}"
    return "none" if isinstance(error, FileNotFoundError) else f"none that can be read: {error.strerror}"
