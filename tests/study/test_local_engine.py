"""Local engine: cells on processes of one thread, of which one that dies costs one cell."""

from dataclasses import replace
from pathlib import Path

import pytest

from asfm.config import Config
from asfm.errors import AsfmError
from asfm.study.cell import Cell, Simulation
from asfm.study.cell_run import CELLS, CellTask
from asfm.study.local_engine import run_tasks
from asfm.study.results_table import Row, read_rows
from asfm.study.task_queue import RunTask
from tests.study.engine_runs import die_at_seed_2, fill_the_disk, log_span, note_process

CELL = Cell(Simulation("tank", "didson", None, 0, 5), 0, "all", "akaze", "default", "default", Config(), 3)
CELLS_OF_SEEDS = [replace(CELL, seed=seed) for seed in range(6)]


def run(folder: Path, cells: list[Cell], jobs: int, function: RunTask) -> tuple[list[Row], list[tuple[int, int]]]:
    (folder / CELLS).mkdir()
    reports: list[tuple[int, int]] = []

    def report(done: int, total: int, left_s: float) -> None:
        assert left_s >= 0 and (left_s == 0) == (done == total)
        reports.append((done, total))

    run_tasks([CellTask(cell) for cell in cells], folder, jobs, function, report)
    return read_rows(folder / CELLS, cells), reports


def test_cells_run_on_several_processes_of_one_thread(tmp_path: Path) -> None:
    rows, reports = run(tmp_path, CELLS_OF_SEEDS, 2, note_process)
    assert [row["seed"] for row in rows] == list(range(6))
    assert reports == [(done, 6) for done in range(1, 7)]
    processes = [row["warnings"].split()[0] for row in rows]
    assert len(set(processes)) == 2, "both take cells, one after the other"
    assert {row["warnings"].split()[1] for row in rows} == {"1"}


def test_a_worker_that_dies_costs_its_cell(tmp_path: Path) -> None:
    rows, reports = run(tmp_path, CELLS_OF_SEEDS, 1, die_at_seed_2)
    assert [row["error"] for row in rows] == [None, None, "the worker process died (signal 9)", None, None, None]
    assert reports[-1] == (6, 6)
    processes = [row["warnings"].split()[0] for row in rows if row["warnings"]]
    assert len(set(processes)) == 2, "another one takes its place"


def test_a_row_that_cannot_be_written_ends_the_study(tmp_path: Path) -> None:
    with pytest.raises(AsfmError, match="No space left on device"):
        run(tmp_path, CELLS_OF_SEEDS, 2, fill_the_disk)


def test_no_worker_waits_for_features_while_there_is_other_work(tmp_path: Path) -> None:
    others = replace(CELL, config=Config.model_validate({"keypoints": {"detector": "orb"}}))
    shared = [replace(CELL, mode=mode) for mode in ("sonar", "odometry", "all")]
    other = replace(others, sequence=replace(CELL.sequence, scene="pier"))  # type: ignore[arg-type]
    rows, _ = run(tmp_path, [*shared, other], 2, log_span)
    spans = [(key, float(begin), float(end)) for key, begin, end in (row["warnings"].split() for row in rows)]
    first, second, _, fourth = spans
    assert first[0] == second[0] != fourth[0]
    assert fourth[1] < first[2], "the other features are begun at once"
    assert second[1] >= min(first[2], fourth[2]), "the second cell of the same features waits until a worker is free"
