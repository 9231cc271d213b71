"""Local engine: the cells of a study on the processes of one machine, one thread each."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from asfm.errors import AsfmError
from asfm.study.cell_run import CELLS, CellTask
from asfm.study.fork_server import get_worker_context, limit_threads, start_fork_server
from asfm.study.results_table import describe_axes, write_row
from asfm.study.task_queue import Report, RunTask, TaskQueue


@dataclass
class _Worker:
    """A process, the pipe to it, and the task it has."""

    process: Any
    pipe: Connection
    task: CellTask | None = None


def run_tasks(tasks: Sequence[CellTask], folder: Path, jobs: int, run: RunTask, report: Report) -> None:
    """Run tasks in worker processes. A worker that dies costs its own cell, whose row says so.

    Args:
        tasks: in the order of the grid.
        folder: of the study.
        jobs: number of processes.
        run: runs one task in a worker, and writes its row.
        report: receives the progress.

    Raises:
        AsfmError: a row cannot be written.
    """
    queue = TaskQueue(tasks, report)
    start_fork_server()
    context = get_worker_context()
    with limit_threads():
        workers = [_start(context, folder, run) for _ in range(min(jobs, len(tasks)))]
        try:
            while not queue.is_empty or any(worker.task for worker in workers):
                for number, worker in enumerate(workers):
                    if worker.task is None and not queue.is_empty:
                        if not worker.process.is_alive():
                            workers[number] = worker = _start(context, folder, run)
                        worker.task = queue.take()
                        worker.pipe.send(worker.task)
                for worker in _wait_for_any(workers):
                    queue.finish(_collect(worker, folder))
        finally:
            _stop(workers)


def _start(context: Any, folder: Path, run: RunTask) -> _Worker:
    own, other = context.Pipe()
    process = context.Process(target=_work, args=(other, folder, run), daemon=True)
    process.start()
    other.close()
    return _Worker(process, own)


def _work(pipe: Connection, folder: Path, run: RunTask) -> None:
    """Run tasks in a worker until the pipe ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends the workers
    threading.Thread(target=_die_with_parent, daemon=True).start()
    import cv2
    from threadpoolctl import threadpool_limits

    cv2.setNumThreads(1)
    with threadpool_limits(1):
        while True:
            try:
                task = pipe.recv()
            except EOFError:
                return
            try:
                run(task, folder)
            except AsfmError as error:
                pipe.send(str(error))
            else:
                pipe.send("")


def _die_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _wait_for_any(workers: list[_Worker]) -> list[_Worker]:
    """Wait until a worker answers or dies."""
    busy = [worker for worker in workers if worker.task is not None]
    ready = wait([worker.pipe for worker in busy] + [worker.process.sentinel for worker in busy])
    return [worker for worker in busy if worker.pipe in ready or worker.process.sentinel in ready]


def _collect(worker: _Worker, folder: Path) -> CellTask:
    """Receive a worker's answer; where it died, write the row of its cell in its place. Return what it had to do."""
    task, worker.task = worker.task, None
    assert task is not None
    try:
        message = worker.pipe.recv()
    except (EOFError, OSError):
        worker.process.join()
        path = folder / CELLS / f"{task.cell.id}.parquet"
        if not path.is_file():
            code = worker.process.exitcode
            how = f"signal {-code}" if code and code < 0 else f"code {code}"
            write_row(path, {**describe_axes(task.cell), "error": f"the worker process died ({how})"})
        return task
    if message:
        raise AsfmError(message)
    return task


def _stop(workers: list[_Worker]) -> None:
    for worker in workers:
        worker.pipe.close()
        if worker.task is not None:
            worker.process.kill()
    for worker in workers:
        worker.process.join()
