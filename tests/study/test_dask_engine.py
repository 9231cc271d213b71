"""Dask engine: real schedulers and workers, workers and schedulers that die, faults that are one line."""

import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from asfm.config import Config
from asfm.errors import AsfmError
from asfm.study import dask_client, dask_engine
from asfm.study.cell import Cell, Simulation
from asfm.study.cell_run import CELLS, CellTask
from asfm.study.dask_worker import ATTEMPTS
from asfm.study.engines import choose_engine
from asfm.study.manifest import MANIFEST
from asfm.study.results_table import Row, read_rows
from asfm.study.task_queue import RunTask
from tests.study.conftest import run_asfm
from tests.study.dask_processes import DaskProcesses, start_dask
from tests.study.engine_runs import die_at_seed_2, fill_the_disk, note_process, wait_a_second
from tests.study.test_study_run import without_seconds

pytest.importorskip("distributed", reason="the extra cluster is not installed")

CELL = Cell(Simulation("tank", "didson", None, 0, 5), 0, "all", "akaze", "default", "default", Config(), 3)
CELLS_OF_SEEDS = [replace(CELL, seed=seed) for seed in range(6)]
LARGEST_WAIT_S = 120


@pytest.fixture(scope="module")
def dask(tmp_path_factory: pytest.TempPathFactory, study_folder: Path) -> Iterator[DaskProcesses]:
    with start_dask(tmp_path_factory.mktemp("dask"), 2, study_folder) as processes:
        yield processes


def run(folder: Path, function: RunTask, **where: object) -> tuple[list[Row], list[tuple[int, int]]]:
    (folder / CELLS).mkdir(exist_ok=True)
    (folder / MANIFEST).write_text("{}")
    reports: list[tuple[int, int]] = []

    def report(done: int, total: int, left_s: float) -> None:
        assert left_s >= 0 and (left_s == 0) == (done == total)
        reports.append((done, total))

    engine = choose_engine(**where)  # type: ignore[arg-type]
    engine([CellTask(cell) for cell in CELLS_OF_SEEDS], folder, function, report)
    return read_rows(folder / CELLS, CELLS_OF_SEEDS), reports


def wait_until(condition: Callable[[], object], process: "subprocess.Popen[str]") -> None:
    deadline_s = time.monotonic() + LARGEST_WAIT_S
    while not condition():
        assert process.poll() is None and time.monotonic() < deadline_s, process.communicate()
        time.sleep(0.01)


def test_cells_run_on_all_workers(tmp_path: Path, dask: DaskProcesses) -> None:
    rows, reports = run(tmp_path, note_process, scheduler=dask.address)
    assert [row["seed"] for row in rows] == list(range(6))
    assert reports == [(done, 6) for done in range(1, 7)]
    processes = {int(row["warnings"].split()[0]) for row in rows}
    assert processes == {worker.pid for worker in dask.workers}
    assert not (tmp_path / ATTEMPTS).exists()


def test_a_row_that_cannot_be_written_ends_the_study(tmp_path: Path, dask: DaskProcesses) -> None:
    with pytest.raises(AsfmError, match="No space left on device"):
        run(tmp_path, fill_the_disk, scheduler=dask.address)


def test_a_cell_that_kills_its_worker_is_tried_twice(tmp_path: Path) -> None:
    cluster = tmp_path / "cluster.yaml"
    cluster.write_text(f"class: local\narguments: {{n_workers: 1, local_directory: {tmp_path / 'scratch'}}}\n")
    rows, reports = run(tmp_path, die_at_seed_2, cluster=cluster)
    expected = [None, None, "the worker process died, at two attempts", None, None, None]
    assert [row["error"] for row in rows] == expected and reports[-1] == (6, 6)


def test_a_scheduler_without_workers_is_not_waited_for_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_client, "NO_WORKER_S", 1.0)
    with start_dask(tmp_path, 0) as dask, pytest.raises(AsfmError, match="has had no worker for 1 s: start workers"):
        run(tmp_path, note_process, scheduler=dask.address)


def test_workers_that_do_not_share_the_folder_are_named(
    tmp_path: Path, dask: DaskProcesses, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / CELLS).mkdir()
    with pytest.raises(AsfmError, match="a worker of the cluster does not see this folder"):
        choose_engine(scheduler=dask.address)([CellTask(CELL)], tmp_path, note_process, lambda *_: None)
    monkeypatch.setattr(dask_engine, "LONGEST_DELAY_S", 0.3)
    (tmp_path / MANIFEST).write_text("{}")
    with pytest.raises(AsfmError, match="expected a folder that is shared"):
        choose_engine(scheduler=dask.address)([CellTask(CELL)], tmp_path, write_nothing, lambda *_: None)


def write_nothing(task: CellTask, folder: Path) -> None:
    """Stand in for a worker whose folder is another one."""


def test_ctrl_c_takes_the_other_cells_back(tmp_path: Path, dask: DaskProcesses) -> None:
    (tmp_path / "study.yaml").write_text(
        "simulate: {scenes: [tank], sonars: [didson], frames: 4}\nseeds: 30\ndetectors: [akaze]\n"
    )
    cells = tmp_path / "results" / CELLS
    process = run_asfm(tmp_path, "study", "study.yaml", "--output", "results", "--scheduler", dask.address, start=True)
    wait_until(lambda: list(cells.glob("[!.]*.parquet")), process)
    process.send_signal(signal.SIGINT)
    output = process.communicate(timeout=30)
    assert (
        process.returncode == 130 and output[1].splitlines()[-1] == "asfm: interrupted; nothing half-written was left"
    )
    assert "Traceback" not in output[1]
    rows, _ = run(tmp_path / "results", wait_a_second, scheduler=dask.address)
    assert len(rows) == 6, "the workers are free for others"
    assert len(list(cells.glob("[!.]*.parquet"))) < 30


def test_a_worker_killed_in_mid_cell_changes_nothing_of_the_table(
    study_folder: Path, tmp_path: Path, dask: DaskProcesses
) -> None:
    for name in ("study.yaml", "study_matchers.py"):
        shutil.copy(study_folder / name, tmp_path)
    cells, attempts = tmp_path / "results" / CELLS, tmp_path / "results" / ATTEMPTS
    again = False

    def is_in_mid_cell() -> bool:
        """Stop both workers, and let them go on unless each is in the middle of a cell."""
        for worker in dask.workers:
            worker.send_signal(signal.SIGSTOP)
        time.sleep(0.02)
        begun = {path.name.rpartition("-")[0] for path in attempts.glob("*")}
        finished = {path.stem for path in cells.glob("[!.]*.parquet")}
        if len(finished) >= 2 and len(begun - finished) == 2:
            return True
        for worker in dask.workers:
            worker.send_signal(signal.SIGCONT)
        time.sleep(0.1)
        return False

    process = run_asfm(tmp_path, "study", "study.yaml", "--output", "results", "--scheduler", dask.address, start=True)
    wait_until(is_in_mid_cell, process)
    dask.workers.pop(0).kill()
    dask.workers[0].send_signal(signal.SIGCONT)
    while process.poll() is None:
        again = again or any(attempts.glob("*-2"))
        time.sleep(0.005)
    output = process.communicate()
    assert process.returncode == 0, output
    assert again, "the cell of the worker that was killed is begun again"
    assert without_seconds(tmp_path / "results") == without_seconds(study_folder / "results")
    assert "study: 16 of 16 cells, 0 s left" in output[1] and "distributed" not in output[1]


def test_a_scheduler_that_dies_is_one_line(tmp_path: Path, dask: DaskProcesses) -> None:
    """The last of these tests: it costs their scheduler."""
    (tmp_path / CELLS).mkdir()
    (tmp_path / MANIFEST).write_text("{}")
    engine, tasks = choose_engine(scheduler=dask.address), [CellTask(cell) for cell in CELLS_OF_SEEDS]
    with pytest.raises(AsfmError, match=r"connection to the Dask scheduler was lost.*run the study again"):
        engine(tasks, tmp_path, note_process, lambda *_: dask.scheduler.kill())
