"""Results of a study: one Parquet file a cell, joined in the order of the grid to results.parquet and results.csv."""

import csv
import io
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from asfm.errors import AsfmError
from asfm.folder_lock import name_temporary
from asfm.results.output_file import write_file
from asfm.study.cell import Cell, Simulation

Row = dict[str, Any]
GAPS = (1, 2, 4, 8)
"""Frame gaps whose matches have columns of their own."""
GAP_METRICS = ("precision", "arc_inlier_ratio", "range_noise_bins", "bearing_noise_beams")
"""Measures of the matches of one frame gap; their columns are named by :func:`gap_column`."""


def gap_column(metric: str, gap: int) -> str:
    """Return the column of a measure of the matches of one frame gap, such as "precision_gap_4"."""
    return f"{metric}_gap_{gap}"


AXES: dict[str, type] = {
    "cell": str,
    "sequence": str,
    "scene": str,
    "sonar": str,
    "detector": str,
    "filters": str,
    "backend": str,
    "mode": str,
    "seed": int,
    "wrong_share": float,
    "wrong_kind": str,
    "stated_range_noise_bins": float,
    "stated_bearing_noise_beams": float,
    "noise_kind": str,
    "stated_recall": float,
    "stated_track_length": int,
}
"""What a cell is; the dials of the corruption are empty where matches were not corrupted."""
METRICS: dict[str, type] = {
    "frames": int,
    "keypoints_per_frame": float,
    "matches": int,
    "precision": float,
    "recall": float,
    "arc_inlier_ratio": float,
    "range_noise_bins": float,
    "bearing_noise_beams": float,
    "range_bias_m": float,
    "bearing_bias_rad": float,
    "track_length": float,
    "track_purity": float,
    "keypoint_coverage": float,
    "match_coverage": float,
    **{gap_column(metric, gap): float for metric in GAP_METRICS for gap in GAPS},
    "ate_m": float,
    "mirror_aware": bool,
    "ate_as_it_is_m": float,
    "odometry_ate_m": float,
    "ate_over_odometry": float,
    "bound_ate_m": float,
    "ate_over_bound": float,
    "stationary_ate_m": float,
    "ate_over_path_percent": float,
    "rotation_rmse_deg": float,
    "rpe_translation_m": float,
    "rpe_rotation_deg": float,
    "warnings": str,
    "missing": str,
    "error": str,
    "seconds": float,
}
"""What was measured; ``seconds`` is that of the computation itself and the only column that differs between runs."""
COLUMNS = {**AXES, **METRICS}


def describe_axes(cell: Cell) -> Row:
    """Return what a cell is, as the first columns of its row."""
    source, row = cell.sequence, Row()
    if isinstance(source, Simulation):
        row = {"scene": Path(source.scene).stem, "sonar": Path(source.sonar).stem}
    if cell.corruption is not None:
        dials = asdict(cell.corruption)
        row |= {name: dials[name] for name in ("wrong_share", "wrong_kind", "noise_kind")}
        stated = ("range_noise_bins", "bearing_noise_beams", "recall", "track_length")
        row |= {f"stated_{name}": dials[name] for name in stated}
    names = {"sequence": source.name, "detector": cell.matcher, "filters": cell.filters, "backend": cell.backend}
    return {"cell": cell.id, **names, "mode": cell.mode, "seed": cell.seed, **row}


def write_row(path: Path, row: Row) -> None:
    """Write the row of one cell, aside and renamed, so that a file that exists is complete.

    Raises:
        AsfmError: the file cannot be written.
        ValueError: a column is unknown: a defect of the caller.
    """
    unknown = set(row) - set(COLUMNS)
    if unknown:
        raise ValueError(f"unknown columns: {', '.join(sorted(unknown))}")
    _write_parquet(path, [row])


def read_rows(folder: Path, cells: Iterable[Cell]) -> list[Row]:
    """Read the rows of those cells that are finished, in their order.

    Raises:
        AsfmError: a file is damaged.
    """
    import pyarrow
    from pyarrow import parquet

    rows = []
    for cell in cells:
        path = folder / f"{cell.id}.parquet"
        if path.is_file():
            try:
                table = parquet.ParquetFile(path).read()
            except (OSError, pyarrow.ArrowException) as error:
                raise AsfmError(f"{path}: cannot read: {error}; delete it, and its cell is run again") from None
            rows += [dict.fromkeys(COLUMNS) | row for row in table.to_pylist()]
    return rows


def write_results(folder: Path, rows: Sequence[Row]) -> None:
    """Write results.parquet and results.csv; numbers in the CSV read back exactly.

    Raises:
        AsfmError: a file cannot be written.
    """
    _write_parquet(folder / "results.parquet", rows)
    write_aside(folder / "results.csv", format_csv(rows).encode())


def format_csv(rows: Sequence[Row], columns: Iterable[str] = COLUMNS) -> str:
    """Format rows as CSV; what is not known is empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(columns), lineterminator="\n", extrasaction="ignore")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def write_aside(path: Path, data: bytes) -> None:
    """Write a file under another name and rename it.

    Raises:
        AsfmError: it cannot be written.
    """
    partial = name_temporary(path.with_name(f".{path.name}"), "partial")  # of this host and process
    try:
        write_file(partial, data)
        partial.replace(path)
    except OSError as error:
        raise AsfmError(f"{path}: cannot write: {error.strerror}") from None
    finally:
        partial.unlink(missing_ok=True)


def _write_parquet(path: Path, rows: Sequence[Row]) -> None:
    import pyarrow
    from pyarrow import parquet

    kinds = {str: pyarrow.string(), int: pyarrow.int64(), float: pyarrow.float64(), bool: pyarrow.bool_()}
    schema = pyarrow.schema([(name, kinds[kind]) for name, kind in COLUMNS.items()])
    sink = pyarrow.BufferOutputStream()
    parquet.write_table(_make_table(rows, schema), sink, compression="zstd")
    write_aside(path, sink.getvalue().to_pybytes())


def _make_table(rows: Sequence[Row], schema: Any) -> Any:
    """Return rows as an Arrow table. By way of JSON: pyarrow's way from Python values imports pandas, for a second."""
    from pyarrow import json as arrow_json

    if not rows:
        return schema.empty_table()
    text = "\n".join(json.dumps(row, default=_get_number) for row in rows).encode()
    options = arrow_json.ParseOptions(explicit_schema=schema, unexpected_field_behavior="error")
    whole = arrow_json.ReadOptions(use_threads=False, block_size=len(text) + 1)
    return arrow_json.read_json(io.BytesIO(text), whole, options)


def _get_number(value: Any) -> Any:
    """Return the number of a NumPy scalar."""
    return value.item()
