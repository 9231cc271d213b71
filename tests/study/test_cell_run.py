"""Run of a cell: a row in any case, a log of defects, and what a seed changes of a recording."""

import errno
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from asfm.config import Config
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError
from asfm.simulation.simulate import simulate
from asfm.study.cell import Cell, External, Recording, Simulation
from asfm.study.cell_run import CELLS, LOGS, CellTask, is_disk_full, run_cell
from asfm.study.results_table import Row, read_rows

TANK = Simulation("tank", "didson", None, 0, 4)


def run(cell: Cell, folder: Path) -> Row:
    (folder / CELLS).mkdir(exist_ok=True)
    run_cell(CellTask(cell), folder)
    (row,) = read_rows(folder / CELLS, [cell])
    return row


def test_a_seed_of_a_recording_is_a_bootstrap_over_its_tracks(tmp_path: Path) -> None:
    sequence = simulate("tank", "didson", 4).sequence
    write_native(tmp_path / "mine", replace(sequence, navigation=None))
    cell = Cell(Recording("mine", tmp_path / "mine", "c"), 0, "odometry", "akaze", "default", "default", Config(), 3)
    rows = [run(replace(cell, seed=seed), tmp_path) for seed in (0, 1, 2, 1)]
    whole, first, second, again = (row["keypoints_per_frame"] for row in rows)
    assert first == again and first != second, "the seed alone decides"
    assert 0.4 * whole < first < 0.85 * whole and rows[1]["matches"] < 0.85 * rows[0]["matches"]
    assert rows[1]["ate_m"] != rows[0]["ate_m"] and rows[0]["error"] is None
    assert rows[0]["precision"] is None and rows[0]["arc_inlier_ratio"] > 0.5
    assert "no true elevations" in rows[0]["missing"]
    assert len([path for path in (tmp_path / "cache" / "features").iterdir() if path.is_dir()]) == 1
    images_only = replace(sequence, navigation=None, odometry=None, groundtruth=None)
    write_native(tmp_path / "bare", images_only)
    bare = replace(cell, sequence=Recording("bare", tmp_path / "bare", "d"))
    row = run(bare, tmp_path)
    assert row["error"] == "bare: mode odometry needs odometry, found none" and row["ate_m"] is None
    assert run(replace(bare, mode="sonar"), tmp_path)["missing"].startswith("no true poses")


def test_what_fails_is_a_row_and_a_defect_has_a_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cell = Cell(TANK, 0, "all", "mine", "default", "default", Config(), 0)
    unknown = replace(cell, external=External("mine", "", function="no_such_module:match"))
    row = run(unknown, tmp_path)
    assert "cannot import no_such_module" in row["error"] and row["seconds"] > 0
    assert not (tmp_path / LOGS).exists()

    def fail(*_: Any, **__: Any) -> Any:
        raise ZeroDivisionError("of asfm")

    monkeypatch.setattr("asfm.study.cell_run.reconstruct", fail)
    row = run(cell, tmp_path)
    assert row["error"] == "defect, ZeroDivisionError: of asfm"
    log = (tmp_path / LOGS / f"{cell.id}.txt").read_text()
    assert cell.label in log and "Traceback" in log and "in fail" in log


def test_a_full_disk_ends_the_study_instead_of_failing_every_cell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fill(*_: Any, **__: Any) -> Any:
        try:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            raise AsfmError(f"cache: cannot write: {error.strerror}") from None

    monkeypatch.setattr("asfm.study.cell_run.provide_sequence", fill)
    cell = Cell(TANK, 0, "all", "mine", "default", "default", Config(), 0)
    with pytest.raises(AsfmError, match="No space left on device; finished cells are kept: make room"):
        run(cell, tmp_path)
    assert not list((tmp_path / CELLS).iterdir())
    assert not is_disk_full(AsfmError("No space left on device")), "words alone are no proof"
