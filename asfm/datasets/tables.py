"""CSV tables with a header and TUM trajectories, validated cell by cell."""

import csv
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from asfm.datasets.value_bounds import check_stamps
from asfm.errors import AsfmError, quote, shorten
from asfm.geometry.poses import pose_from_tum
from asfm.regular_file import read_text
from asfm.types import FloatArray, IntArray, Trajectory

Row = tuple[int, list[str]]
"""Line number, counted from 1, and the cells on that line."""

MAX_NUMBER = 1e30
"""Squares and cubes of larger numbers overflow."""
MAX_POSITION_M = 1e9
"""Coordinates of every map projection, and those about the Earth's centre, are smaller."""
TUM_COLUMNS = ("timestamp_s", "x", "y", "z", "qx", "qy", "qz", "qw")
NO_POSE = ("0", "0", "0", "0", "0", "0", "1")
"""Cells that stand in for those of a row without a pose."""
QUATERNION_NORM_TOLERANCE = 0.1
"""Rounding in text changes the norm by far less; a larger deviation means that the columns are in another order."""


def read_csv(
    path: Path, required: tuple[str, ...], optional: tuple[str, ...] = (), may_be_empty: bool = False
) -> tuple[dict[str, int], list[Row]]:
    """Read a CSV file whose header names the columns, in any order.

    Args:
        path: the file, UTF-8.
        required: names of the columns that must be there.
        optional: names of the columns that may be there.
        may_be_empty: accept a table that has a header and no rows.

    Returns:
        The position of each column by name, and the rows that are not blank.

    Raises:
        AsfmError: the file cannot be read, a column is missing, unknown or repeated, a row has too few or too many
            cells, or there are no rows.
    """
    rows = list(_split_lines(path, csv_lines=True))
    expected = ",".join(required) + "".join(f"[,{name}]" for name in optional)
    if not rows:
        raise AsfmError(f"{path}: expected a header {expected}, found an empty file")
    header = rows[0][1]
    unknown = [name for name in header if name not in required + optional]
    missing = [name for name in required if name not in header]
    found = shorten(",".join(header[:100]))
    if unknown or missing or len(set(header)) < len(header):
        raise AsfmError(f"{path}, line {rows[0][0]}: expected the header {expected}, found {found}")
    if len(rows) == 1 and not may_be_empty:
        raise AsfmError(f"{path}: expected at least one row below the header, found none")
    for line, cells in rows[1:]:
        if len(cells) != len(header):
            raise AsfmError(f"{path}, line {line}: expected {len(header)} cells, found {len(cells)}")
    return {name: position for position, name in enumerate(header)}, rows[1:]


def read_tum(path: Path, may_be_lost: bool = False) -> Trajectory:
    """Read a trajectory in the TUM format: rows of t x y z qx qy qz qw in seconds and metres; # starts a comment.

    Args:
        path: the file, UTF-8.
        may_be_lost: accept rows without a pose, NaN or a quaternion of zeros, as trackers write while they are lost;
            their poses are NaN.

    Returns:
        The poses (N, 4, 4) and their stamps (N,).

    Raises:
        AsfmError: the file cannot be read or is empty, or a row is incomplete, not finite, not later than the one
            before, or its quaternion is not of unit length.
    """
    rows = list(_split_lines(path, csv_lines=False))
    if not rows:
        raise AsfmError(f"{path}: expected rows of {' '.join(TUM_COLUMNS)}, found none")
    for line, cells in rows:
        if len(cells) != len(TUM_COLUMNS):
            raise AsfmError(
                f"{path}, line {line}: expected {len(TUM_COLUMNS)} numbers {' '.join(TUM_COLUMNS)}, found {len(cells)}"
            )
    lost = [may_be_lost and _holds_no_pose(cells) for _, cells in rows]
    measured = [
        (line, cells[:1] + list(NO_POSE) if gone else cells) for (line, cells), gone in zip(rows, lost, strict=True)
    ]
    values = np.stack([parse_numbers(path, measured, column, name) for column, name in enumerate(TUM_COLUMNS)], axis=1)
    check_increasing(path, rows, values[:, 0])
    for index in np.flatnonzero(np.abs(values[:, 1:4]).max(axis=1) > MAX_POSITION_M)[:1]:
        found = quote(rows[index][1][1:4])
        raise AsfmError(
            f"{path}, line {rows[index][0]}: expected x y z in metres, {MAX_POSITION_M:g} at most, found {found}"
        )
    norms = np.linalg.norm(values[:, 4:], axis=1)
    for index in np.flatnonzero(np.abs(norms - 1.0) > QUATERNION_NORM_TOLERANCE)[:1]:
        raise AsfmError(
            f"{path}, line {rows[index][0]}: expected a unit quaternion qx qy qz qw, found length {norms[index]:g}"
        )
    poses = pose_from_tum(values[:, 1:])
    poses[lost] = np.nan
    return Trajectory(values[:, 0].copy(), poses)


def _holds_no_pose(cells: list[str]) -> bool:
    """Return whether the cells of a pose are NaN or infinite, or its quaternion is zero."""
    try:
        values = np.array([float(cell) for cell in cells[1:]])
    except ValueError:
        return False
    return not np.isfinite(values).all() or not values[3:].any()


def parse_numbers(path: Path, rows: list[Row], column: int, name: str) -> FloatArray:
    """Parse one column as finite numbers.

    Args:
        path: the file, for messages.
        rows: rows of :func:`read_csv`.
        column: position of the column.
        name: name of the column, for messages.

    Returns:
        (N,) float64, one number per row.

    Raises:
        AsfmError: a cell is not a finite number, or beyond every unit.
    """
    values = np.array([_parse(float, path, row, column, name, "a number") for row in rows])
    for index in np.flatnonzero(~(np.abs(values) <= MAX_NUMBER))[:1]:
        line, cells = rows[index]
        if np.isfinite(values[index]):
            name += f" up to {MAX_NUMBER:g}"
        raise AsfmError(f"{path}, line {line}: expected a finite {name}, found {shorten(cells[column])}")
    return values


def parse_integers(path: Path, rows: list[Row], column: int, name: str) -> IntArray:
    """Parse one column as integers; arguments as for :func:`parse_numbers`.

    Returns:
        (N,) int64, one number per row.

    Raises:
        AsfmError: a cell is not an integer of 64 bits.
    """
    return np.array([_parse(_parse_int64, path, row, column, name, "a whole number") for row in rows], dtype=np.int64)


def check_increasing(path: Path, rows: list[Row], timestamps_s: FloatArray) -> None:
    """Check that the stamps (N,) can be seconds and increase strictly.

    Raises:
        AsfmError: a stamp is in another unit, or not later than the one before.
    """
    check_stamps(path, timestamps_s, [line for line, _ in rows])
    for index in np.flatnonzero(np.diff(timestamps_s) <= 0)[:1]:
        previous_s, found_s = float(timestamps_s[index]), float(timestamps_s[index + 1])
        raise AsfmError(
            f"{path}, line {rows[index + 1][0]}: expected a timestamp_s after {previous_s!r} (line {rows[index][0]}), "
            f"found {found_s!r}: stamps must rise and never repeat"
        )


def _parse_int64(text: str) -> int:
    return int(np.int64(text))


def _parse(convert: Callable[[str], float], path: Path, row: Row, column: int, name: str, expected: str) -> float:
    line, cells = row
    try:
        return convert(cells[column])
    except (ValueError, OverflowError):
        raise AsfmError(f"{path}, line {line}: expected {expected} as {name}, found {quote(cells[column])}") from None


def _split_lines(path: Path, csv_lines: bool) -> Iterator[Row]:
    lines = read_text(path, "a table").splitlines()
    if not csv_lines:
        split = (line.partition("#")[0].split() for line in lines)
        return ((number, cells) for number, cells in enumerate(split, start=1) if cells)
    try:
        cells_of_lines = [next(csv.reader([line], strict=True), []) for line in lines]
    except csv.Error as error:
        raise AsfmError(f"{path}: cannot read the table: {shorten(str(error))}") from None
    stripped = ([cell.strip() for cell in cells] for cells in cells_of_lines)
    return ((number, cells) for number, cells in enumerate(stripped, start=1) if any(cells))
