"""Run of a cell on a Dask worker: rows that are there, attempts that are counted, faults that are returned."""

from pathlib import Path

import pytest

from asfm import __version__
from asfm.config import Config
from asfm.errors import AsfmError
from asfm.study.cell import Cell, Simulation
from asfm.study.cell_run import CELLS, CellTask
from asfm.study.dask_worker import ATTEMPTS, has_attempts_left, run_on_worker
from asfm.study.manifest import MANIFEST
from asfm.study.results_table import describe_axes, read_rows, write_row

CELL = Cell(Simulation("tank", "didson", None, 0, 5), 0, "all", "akaze", "default", "default", Config(), 3)
TASK = CellTask(CELL)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in (CELLS, ATTEMPTS):
        (tmp_path / name).mkdir()
    (tmp_path / MANIFEST).write_text("{}")
    return tmp_path


def work(task: CellTask, folder: Path) -> None:
    write_row(folder / CELLS / f"{task.cell.id}.parquet", {**describe_axes(task.cell), "matches": 7})


def die(task: CellTask, folder: Path) -> None:
    raise SystemExit


def refuse(task: CellTask, folder: Path) -> None:
    raise AssertionError("this cell is not to be run")


def test_a_cell_that_was_begun_twice_is_not_begun_again(folder: Path) -> None:
    for left in (True, False):
        with pytest.raises(SystemExit):
            run_on_worker(TASK, folder, die, __version__)
        assert has_attempts_left(folder, CELL.id) == left
    assert run_on_worker(TASK, folder, refuse, __version__) == ""
    assert [row["error"] for row in read_rows(folder / CELLS, [CELL])] == ["the worker process died, at two attempts"]


def test_a_second_attempt_may_succeed_and_a_row_is_not_computed_again(folder: Path) -> None:
    with pytest.raises(SystemExit):
        run_on_worker(TASK, folder, die, __version__)
    assert run_on_worker(TASK, folder, work, __version__) == ""
    assert run_on_worker(TASK, folder, refuse, __version__) == ""
    (row,) = read_rows(folder / CELLS, [CELL])
    assert row["matches"] == 7 and row["error"] is None


def test_faults_are_returned(folder: Path) -> None:
    def fail(task: CellTask, folder: Path) -> None:
        raise AsfmError(f"{folder}: cannot write: No space left on device")

    assert "No space left" in run_on_worker(TASK, folder, fail, __version__)
    assert f"has asfm {__version__}, this is 0.0.1" in run_on_worker(TASK, folder, refuse, "0.0.1")
    (folder / ATTEMPTS).rename(folder / "elsewhere")
    assert "cannot write: No such file" in run_on_worker(TASK, folder, refuse, __version__)
    (folder / MANIFEST).unlink()
    assert "does not see this folder" in run_on_worker(TASK, folder, refuse, __version__)
