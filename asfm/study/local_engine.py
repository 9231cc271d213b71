"""Local engine: the cells of a study on the processes of one machine, one thread each."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from asfm.errors import AsfmError
from asfm.study.cell_run import CELLS, CellTask
from asfm.study.results_table import describe_axes, write_row

Report = Callable[[int, int, float], None]
"""Called as report(cells done, all cells, seconds left) after each cell."""
RunTask = Callable[[CellTask, Path], None]
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
PRELOADED = ["asfm.study.cell_run", "pyarrow.parquet"]


@dataclass
class _Worker:
    """A process, the pipe to it, and the task it has."""

    process: Any
    pipe: Connection
    task: CellTask | None = None
    keys: frozenset[str] = field(default_factory=frozenset)


def run_tasks(tasks: Sequence[CellTask], folder: Path, jobs: int, run: RunTask, report: Report) -> None:
    """Run tasks in worker processes. A worker that dies costs its own cell, whose row says so.

    Cells whose shared features are being computed by another worker are put off while there are others.

    Args:
        tasks: in the order of the grid.
        folder: of the study.
        jobs: number of processes.
        run: runs one task in a worker, and writes its row.
        report: receives the progress.

    Raises:
        AsfmError: a row cannot be written.
    """
    pending, done, begin_s = list(tasks), 0, time.monotonic()
    context = _make_context()
    with _one_thread():
        workers = [_start(context, folder, run) for _ in range(min(jobs, len(pending)))]
        made: set[str] = set()
        try:
            while pending or any(worker.task for worker in workers):
                for number, worker in enumerate(workers):
                    if worker.task is None and pending:
                        if not worker.process.is_alive():
                            workers[number] = worker = _start(context, folder, run)
                        _give(worker, pending, workers, made)
                for worker in _wait_for_any(workers):
                    _collect(worker, folder)
                    made |= worker.keys
                    worker.task, worker.keys, done = None, frozenset(), done + 1
                    left_s = (time.monotonic() - begin_s) / done * (len(tasks) - done)
                    report(done, len(tasks), left_s)
        finally:
            _stop(workers)


def _make_context() -> Any:
    """Return the way of starting processes: libraries with threads do not survive a fork of this one."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    return context


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let libraries that new processes load use one thread: the variables are read when they are loaded."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


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


def _give(worker: _Worker, pending: list[CellTask], workers: list[_Worker], made: set[str]) -> None:
    """Give a worker the first task that need not wait for what another worker is making."""
    being_made = {key for other in workers if other.task is not None for key in other.keys} - made
    free = (number for number, task in enumerate(pending) if not _keys(task) & being_made)
    worker.task = pending.pop(next(free, 0))
    worker.keys = _keys(worker.task)
    worker.pipe.send(worker.task)


def _keys(task: CellTask) -> frozenset[str]:
    """Return the keys of what is made once for several cells."""
    return frozenset({task.cell.sequence_key, task.cell.features_key})


def _wait_for_any(workers: list[_Worker]) -> list[_Worker]:
    """Wait until a worker answers or dies."""
    busy = [worker for worker in workers if worker.task is not None]
    ready = wait([worker.pipe for worker in busy] + [worker.process.sentinel for worker in busy])
    return [worker for worker in busy if worker.pipe in ready or worker.process.sentinel in ready]


def _collect(worker: _Worker, folder: Path) -> None:
    """Receive a worker's answer; where it died, write the row of its cell in its place."""
    assert worker.task is not None
    try:
        message = worker.pipe.recv()
    except (EOFError, OSError):
        worker.process.join()
        path = folder / CELLS / f"{worker.task.cell.id}.parquet"
        if not path.is_file():
            code = worker.process.exitcode
            how = f"signal {-code}" if code and code < 0 else f"code {code}"
            write_row(path, {**describe_axes(worker.task.cell), "error": f"the worker process died ({how})"})
        return
    if message:
        raise AsfmError(message)


def _stop(workers: list[_Worker]) -> None:
    for worker in workers:
        worker.pipe.close()
        if worker.task is not None:
            worker.process.kill()
    for worker in workers:
        worker.process.join()
