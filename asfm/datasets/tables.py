"""Text tables of a sequence: CSV with a header and TUM trajectories, checked cell by cell."""

import csv
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from asfm.errors import AsfmError
from asfm.geometry.poses import pose_from_tum
from asfm.types import FloatArray, Trajectory

Row = tuple[int, list[str]]
"""Line number, counted from 1, and the cells of that line."""

TUM_COLUMNS = ("timestamp_s", "x", "y", "z", "qx", "qy", "qz", "qw")
QUATERNION_NORM_TOLERANCE = 0.1
"""Rounded text is off by far less; more than this means that the columns are not what they should be."""


def read_csv(
    path: Path, required: tuple[str, ...], optional: tuple[str, ...] = (), may_be_empty: bool = False
) -> tuple[dict[str, int], list[Row]]:
    """Read a CSV file whose header names its columns, in any order.

    Returns:
        The position of each column by name, and the rows that are not blank, at least one unless it may be empty.

    Raises:
        AsfmError: the file cannot be read, a column is missing or unknown, a row is short or long, there is no row.
    """
    rows = list(_split_lines(path, csv_lines=True))
    expected = ",".join(required) + "".join(f"[,{name}]" for name in optional)
    if not rows:
        raise AsfmError(f"{path}: expected a header {expected}, found an empty file")
    header = rows[0][1]
    unknown = [name for name in header if name not in required + optional]
    missing = [name for name in required if name not in header]
    if unknown or missing or len(set(header)) < len(header):
        raise AsfmError(f"{path}, line {rows[0][0]}: expected the header {expected}, found {','.join(header)}")
    if len(rows) == 1 and not may_be_empty:
        raise AsfmError(f"{path}: expected at least one row below the header, found none")
    for line, cells in rows[1:]:
        if len(cells) != len(header):
            raise AsfmError(f"{path}, line {line}: expected {len(header)} cells, found {len(cells)}")
    return {name: position for position, name in enumerate(header)}, rows[1:]


def read_tum(path: Path) -> Trajectory:
    """Read a trajectory in TUM order: t x y z qx qy qz qw, separated by blanks; # starts a comment.

    Raises:
        AsfmError: naming file and line where a row is short, not finite or out of order, or no rotation.
    """
    rows = list(_split_lines(path, csv_lines=False))
    if not rows:
        raise AsfmError(f"{path}: expected rows of {' '.join(TUM_COLUMNS)}, found none")
    for line, cells in rows:
        if len(cells) != len(TUM_COLUMNS):
            raise AsfmError(
                f"{path}, line {line}: expected {len(TUM_COLUMNS)} numbers {' '.join(TUM_COLUMNS)}, found {len(cells)}"
            )
    values = np.stack([parse_numbers(path, rows, column, name) for column, name in enumerate(TUM_COLUMNS)], axis=1)
    check_rising(path, rows, values[:, 0])
    norm = np.linalg.norm(values[:, 4:], axis=1)
    for index in np.flatnonzero(np.abs(norm - 1.0) > QUATERNION_NORM_TOLERANCE)[:1]:
        raise AsfmError(
            f"{path}, line {rows[index][0]}: expected a unit quaternion qx qy qz qw, found length {norm[index]:g}"
        )
    return Trajectory(values[:, 0].copy(), pose_from_tum(values[:, 1:]))


def parse_numbers(path: Path, rows: list[Row], column: int, name: str) -> FloatArray:
    """Parse one column as finite numbers. Returns (rows,)."""
    values = np.array([_parse(float, path, row, column, name, "a number") for row in rows])
    for index in np.flatnonzero(~np.isfinite(values))[:1]:
        line, cells = rows[index]
        raise AsfmError(f"{path}, line {line}: expected a finite {name}, found {cells[column]}")
    return values


def parse_integers(path: Path, rows: list[Row], column: int, name: str) -> "np.ndarray[tuple[int], np.dtype[np.int64]]":
    """Parse one column as whole numbers. Returns (rows,)."""
    return np.array([_parse(_parse_int64, path, row, column, name, "a whole number") for row in rows], dtype=np.int64)


def check_rising(path: Path, rows: list[Row], timestamps_s: FloatArray) -> None:
    """Raise AsfmError where a stamp is not later than the one before it."""
    for index in np.flatnonzero(np.diff(timestamps_s) <= 0)[:1]:
        before, found = float(timestamps_s[index]), float(timestamps_s[index + 1])
        raise AsfmError(
            f"{path}, line {rows[index + 1][0]}: expected a timestamp_s after {before!r} (line {rows[index][0]}), "
            f"found {found!r}: stamps must rise and never repeat"
        )


def _parse_int64(text: str) -> int:
    return int(np.int64(text))


def _parse(convert: Callable[[str], float], path: Path, row: Row, column: int, name: str, expected: str) -> float:
    line, cells = row
    try:
        return convert(cells[column])
    except (ValueError, OverflowError):
        raise AsfmError(f"{path}, line {line}: expected {expected} as {name}, found {cells[column]!r}") from None


def _split_lines(path: Path, csv_lines: bool) -> Iterator[Row]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise AsfmError(f"{path}: expected a file, found none") from None
    except (OSError, UnicodeDecodeError) as error:
        raise AsfmError(f"{path}: cannot read the table: {error}") from None
    lines = text.splitlines()
    if not csv_lines:
        split = (line.partition("#")[0].split() for line in lines)
        return ((number, cells) for number, cells in enumerate(split, start=1) if cells)
    try:
        cells_of_lines = [next(csv.reader([line], strict=True), []) for line in lines]
    except csv.Error as error:
        raise AsfmError(f"{path}: cannot read the table: {error}") from None
    stripped = ([cell.strip() for cell in cells] for cells in cells_of_lines)
    return ((number, cells) for number, cells in enumerate(stripped, start=1) if any(cells))
