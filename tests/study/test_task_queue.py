"""Queue of the cells: its order, cells that share what another one is making, progress."""

from dataclasses import replace

from asfm.config import Config
from asfm.study.cell import Cell, Simulation
from asfm.study.cell_run import CellTask
from asfm.study.task_queue import TaskQueue

CELL = Cell(Simulation("tank", "didson", None, 0, 5), 0, "all", "akaze", "default", "default", Config(), 3)
SHARED = [CellTask(replace(CELL, mode=mode)) for mode in ("sonar", "odometry", "all")]
OTHER = CellTask(replace(CELL, seed=1))


def ignore(done: int, total: int, left_s: float) -> None:
    pass


def test_cells_that_share_what_is_being_made_are_put_off_while_there_are_others() -> None:
    queue = TaskQueue([*SHARED, OTHER], ignore)
    assert queue.take() is SHARED[0] and queue.take() is OTHER
    assert queue.take() is SHARED[1], "nothing else is left"
    queue = TaskQueue([*SHARED, OTHER], ignore)
    queue.finish(queue.take())
    assert queue.take() is SHARED[1], "what they share is there"


def test_a_task_that_is_put_back_is_the_next() -> None:
    queue = TaskQueue([*SHARED, OTHER], ignore)
    task = queue.take()
    queue.put_back(task)
    assert queue.take() is task and not queue.is_empty


def test_progress_counts_what_is_finished() -> None:
    reports: list[tuple[int, int]] = []
    queue = TaskQueue([*SHARED, OTHER], lambda done, total, left_s: reports.append((done, total)))
    while not queue.is_empty:
        queue.finish(queue.take())
    assert reports == [(1, 4), (2, 4), (3, 4), (4, 4)]
