"""Writing of result files: finite numbers only, and one-line errors."""

from pathlib import Path

import numpy as np

from asfm.errors import AsfmError
from asfm.types import FloatArray


def write_file(path: Path, data: bytes) -> None:
    """Write bytes to a file.

    Raises:
        AsfmError: the file cannot be written.
    """
    try:
        path.write_bytes(data)
    except OSError as error:
        raise AsfmError(f"{path}: cannot write: {error.strerror}") from None


def write_lines(path: Path, lines: list[str]) -> None:
    """Write lines of UTF-8 text, each ended by a newline.

    Raises:
        AsfmError: the file cannot be written.
    """
    write_file(path, "\n".join([*lines, ""]).encode())


def format_stamps(timestamps_s: FloatArray) -> list[str]:
    """Format (N,) time stamps as the shortest decimals that read back exactly."""
    return [np.format_float_positional(stamp, trim="0") for stamp in timestamps_s]


def require_finite(what: str, *arrays: FloatArray) -> None:
    """Check that arrays of one row per item hold finite numbers only.

    Raises:
        ValueError: a value is not finite; the message names ``what`` and the row: a defect of the caller.
    """
    for array in arrays:
        bad = np.argwhere(~np.isfinite(array))
        if len(bad):
            raise ValueError(f"{what}: row {bad[0][0]} is not finite")
