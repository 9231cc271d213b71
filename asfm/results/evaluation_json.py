"""evaluation.json: pose errors, consistency and matcher quality of a run."""

import math
from pathlib import Path
from typing import Any

from asfm.errors import AsfmError, quote
from asfm.evaluation.evaluation_table import EvaluationRow, EvaluationTable
from asfm.results.json_file import write_json
from asfm.results.results_folder import EVALUATION, EVALUATION_PARTIAL
from asfm.safe_json import read_json

EXPECTED = "an evaluation that asfm wrote"
REMEDY = "run asfm evaluate again"
ERRORS = ("ate_", "rpe_", "rotation_rmse", "nees_", "bound_", "match_count")
SHARES = ("match_precision", "match_recall", "match_arc_inlier_ratio")
"""Beginnings of the keys of measures that are not negative, and of those between 0 and 1."""


def write_evaluation(folder: Path, table: EvaluationTable) -> None:
    """Write or replace the evaluation in a results folder; an interruption leaves the old file intact.

    Raises:
        AsfmError: the file cannot be written.
    """
    path, partial = folder / EVALUATION, folder / EVALUATION_PARTIAL
    try:
        write_json(partial, table.as_dict())
        partial.replace(path)
    except OSError as error:
        raise AsfmError(f"{path}: cannot write: {error.strerror}") from None
    finally:
        partial.unlink(missing_ok=True)


def read_evaluation(folder: Path) -> EvaluationTable:
    """Read the evaluation in a results folder.

    Raises:
        AsfmError: there is none, it cannot be read, or it is none that asfm wrote.
    """
    path = folder / EVALUATION
    content = read_json(path, EXPECTED)
    rows, notes = (content.get(key) if isinstance(content, dict) else None for key in ("rows", "notes"))
    if not isinstance(rows, list) or not isinstance(notes, list) or not all(isinstance(note, str) for note in notes):
        raise AsfmError(f"{path}: expected {EXPECTED}, with rows and notes, found none of these; {REMEDY}")
    reference = content.get("reference")
    table = EvaluationTable(
        tuple(_read_row(path, number, row) for number, row in enumerate(rows)),
        tuple(notes),
        reference if isinstance(reference, str) else None,
    )
    _check_values(path, table)
    return table


def _check_values(path: Path, table: EvaluationTable) -> None:
    """Refuse evaluations without rows, with a row twice, and with values that their measures cannot have."""
    if not table.rows:
        raise AsfmError(f"{path}: expected {EXPECTED}, with rows, found none; {REMEDY}")
    keys = [row.key for row in table.rows]
    for number, row in enumerate(table.rows):
        if row.key in keys[:number]:
            raise AsfmError(f"{path}, row {number}: expected each key once, found {quote(row.key)} again; {REMEDY}")
        if row.key.startswith(ERRORS) and row.value < 0:
            raise AsfmError(f"{path}, row {number}: expected an error of 0 or more, found {row.value:g}; {REMEDY}")
        if row.key.startswith(SHARES) and not 0 <= row.value <= 1:
            raise AsfmError(f"{path}, row {number}: expected a share of 0 to 1, found {row.value:g}; {REMEDY}")


def _read_row(path: Path, number: int, row: Any) -> EvaluationRow:
    """Check one row; a missing ratio or value of the odometry is None."""
    cells = row if isinstance(row, dict) else {}
    key, name, unit = (cells.get(column) for column in ("key", "name", "unit"))
    if not (isinstance(key, str) and isinstance(name, str) and isinstance(unit, str)):
        raise AsfmError(f"{path}, row {number}: expected a key, a name and a unit, found {quote(row)}; {REMEDY}")
    value, odometry, ratio = (_read_number(path, number, cells, column) for column in ("value", "odometry", "ratio"))
    if value is None:
        raise AsfmError(f"{path}, row {number}: expected a value, found none; {REMEDY}")
    return EvaluationRow(key, name, value, unit, odometry, ratio, cells.get("detail") is True)


def _read_number(path: Path, number: int, cells: dict[str, Any], column: str) -> float | None:
    value = cells.get(column)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise AsfmError(f"{path}, row {number}: expected a finite number as {column}, found {quote(value)}; {REMEDY}")
    return float(value)
