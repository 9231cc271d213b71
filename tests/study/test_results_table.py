"""Tables of results: rows by cell, files that are whole or absent, CSV that reads back."""

import csv
import io
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pyarrow import parquet

from asfm.config import Config
from asfm.errors import AsfmError
from asfm.study.cell import Cell, Corruption, Recording, Simulation
from asfm.study.results_table import (
    COLUMNS,
    describe_axes,
    format_csv,
    read_rows,
    write_aside,
    write_results,
    write_row,
)
from tests.study.conftest import ROOT

CELL = Cell(Simulation("tank", "didson", None, 0, 5), 4, "sonar", "akaze", "default", "default", Config(), 3)
SPECIAL = [np.nan, np.inf, -np.inf, -0.0]
CORRUPTION = Corruption(0.1, "random", 0.5, 0.25, "white", 0.9, 7, 50)


def test_axes_name_the_dials_of_corrupted_cells_only() -> None:
    row = describe_axes(CELL)
    assert (row["cell"], row["scene"], row["sonar"], row["seed"]) == (CELL.id, "tank", "didson", 4)
    assert "wrong_share" not in row
    corrupted = describe_axes(replace(CELL, corruption=CORRUPTION))
    assert (corrupted["wrong_share"], corrupted["stated_recall"], corrupted["stated_track_length"]) == (0.1, 0.9, 7)
    assert (corrupted["stated_range_noise_bins"], corrupted["stated_bearing_noise_beams"]) == (0.5, 0.25)
    assert "scene" not in describe_axes(replace(CELL, sequence=Recording("a", Path("a"), "c")))


def test_rows_are_read_in_the_order_of_the_cells(tmp_path: Path) -> None:
    cells = [replace(CELL, seed=seed) for seed in (3, 1, 2)]
    for cell in (cells[2], cells[0]):
        write_row(tmp_path / f"{cell.id}.parquet", {**describe_axes(cell), "ate_m": 0.1 / cell.seed, "seconds": 1.5})
    rows = read_rows(tmp_path, cells)
    assert [row["seed"] for row in rows] == [3, 2] and list(rows[0]) == list(COLUMNS)
    assert rows[0]["ate_m"] == 0.1 / 3 and rows[0]["precision"] is None
    write_results(tmp_path, rows)
    text = (tmp_path / "results.csv").read_text()
    (first, second) = csv.DictReader(io.StringIO(text))
    assert float(first["ate_m"]) == 0.1 / 3 and first["precision"] == "" and second["seed"] == "2"
    assert (tmp_path / "results.parquet").stat().st_size > 0


def test_rows_of_before_a_column_was_added_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    newer = dict(COLUMNS)
    monkeypatch.delitem(COLUMNS, "precision_gap_8")
    write_row(tmp_path / f"{CELL.id}.parquet", {**describe_axes(CELL), "precision_gap_4": 0.5})
    monkeypatch.setitem(COLUMNS, "precision_gap_8", newer["precision_gap_8"])
    (row,) = read_rows(tmp_path, [CELL])
    assert row["precision_gap_4"] == 0.5 and row["precision_gap_8"] is None


def test_a_damaged_row_says_what_to_do(tmp_path: Path) -> None:
    (tmp_path / f"{CELL.id}.parquet").write_bytes(b"PAR1 and no more")
    with pytest.raises(AsfmError, match=r"cannot read: .*delete it, and its cell is run again"):
        read_rows(tmp_path, [CELL])


def test_unknown_columns_are_a_defect(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="unknown columns: colour"):
        write_row(tmp_path / "a.parquet", {"colour": 1})


def test_what_cannot_be_written_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_aside(path, b"old")
    write_aside(path, b"new")
    assert path.read_bytes() == b"new" and list(tmp_path.iterdir()) == [path]
    with pytest.raises(AsfmError, match="cannot write"):
        write_aside(tmp_path / "nowhere" / "a.txt", b"x")


def test_text_with_commas_is_quoted() -> None:
    assert format_csv([{"a": 'x, "y"', "b": None}], ["a", "b"]) == 'a,b\n"x, ""y""",\n'


def test_numbers_and_text_are_kept_to_the_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    values = np.frombuffer(rng.bytes(8 * 500), dtype=np.float64)
    rows = [{**describe_axes(CELL), "ate_m": value, "matches": np.int64(2**63 - 1)} for value in values[:-4]]
    odd = [{"warnings": 'a "b"\n\t\\ \u20ac \x00', "mirror_aware": np.bool_(True), "ate_m": value} for value in SPECIAL]
    write_results(tmp_path, [*rows, *odd])
    table = parquet.ParquetFile(tmp_path / "results.parquet").read()
    found = np.array(table["ate_m"].to_pylist(), dtype=np.float64)
    expected = np.array([*values[:-4], *SPECIAL])
    same = (found.view(np.int64) == expected.view(np.int64)) | (np.isnan(found) & np.isnan(expected))
    assert same.all() and table.schema.names == list(COLUMNS)
    last = table.to_pylist()[-1]
    assert last["warnings"] == odd[0]["warnings"] and last["mirror_aware"] is True
    assert table["matches"][0].as_py() == 2**63 - 1
    write_results(tmp_path, [])
    assert parquet.ParquetFile(tmp_path / "results.parquet").read().schema == table.schema


def test_rows_are_written_and_read_without_pandas(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from asfm.study.results_table import write_results, read_rows\n"
        "from types import SimpleNamespace as Cell\n"
        "folder = Path(sys.argv[1]); write_results(folder, [{'ate_m': 1.5}])\n"
        "assert read_rows(folder, [Cell(id='results')])[0]['ate_m'] == 1.5 and 'pandas' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], cwd=ROOT, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
