"""Dask engine: the cells of a study on the workers of a Dask scheduler, which write their rows to a shared folder."""

import os
import shutil
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any

from asfm import __version__
from asfm.errors import AsfmError, shorten
from asfm.study.cell_run import CELLS, CellTask
from asfm.study.dask_client import CONNECTION_ERRORS, describe_loss
from asfm.study.dask_worker import ATTEMPTS, DIED, has_attempts_left, run_on_worker
from asfm.study.results_table import describe_axes, write_row
from asfm.study.task_queue import Report, RunTask, TaskQueue

Connect = Callable[[], AbstractContextManager[tuple[Any, float]]]
"""Opens a client, and says how many seconds there may be no worker."""
POLL_S = 1.0
LONGEST_DELAY_S = 60.0
"""Until a file that another machine has written is seen here."""


def run_tasks_on_dask(tasks: Sequence[CellTask], folder: Path, connect: Connect, run: RunTask, report: Report) -> None:
    """Run tasks on the workers of a Dask scheduler. A cell whose worker dies is begun once more.

    Args:
        tasks: in the order of the grid.
        folder: of the study; the workers see it under the same path.
        connect: opens the client.
        run: runs one task in a worker, and writes its row.
        report: receives the progress.

    Raises:
        AsfmError: the scheduler cannot be reached or is lost, has no workers for long, or a worker cannot run a cell or
            write its row where this process sees it.
    """
    folder, queue = folder.resolve(), TaskQueue(tasks, report)
    attempts = folder / ATTEMPTS
    shutil.rmtree(attempts, ignore_errors=True)
    try:
        attempts.mkdir()
    except OSError as error:
        raise AsfmError(f"{attempts}: cannot make the folder: {error.strerror}") from None
    with connect() as (client, patience_s):
        _run_all(client, queue, folder, run, patience_s)
    shutil.rmtree(attempts, ignore_errors=True)


def _run_all(client: Any, queue: TaskQueue, folder: Path, run: RunTask, patience_s: float) -> None:
    running: dict[Any, CellTask] = {}
    seen_s = time.monotonic()
    try:
        while running or not queue.is_empty:
            workers = len(client.nthreads())
            seen_s = time.monotonic() if workers else seen_s
            if time.monotonic() - seen_s > patience_s:
                raise AsfmError(f"the Dask scheduler has had no worker for {patience_s:.0f} s: start workers for it")
            while not queue.is_empty and len(running) < max(workers, 1):
                task = queue.take()
                arguments = (task, folder, run, __version__)
                running[client.submit(run_on_worker, *arguments, pure=False, key=_name_key(task))] = task
            for future in _wait_for_any(list(running)):
                _collect(future, running.pop(future), queue, folder)
    except CONNECTION_ERRORS as error:
        raise AsfmError(describe_loss(error)) from None
    finally:
        with suppress(*CONNECTION_ERRORS):
            client.cancel(list(running), force=True)


def _name_key(task: CellTask) -> str:
    """Return a name for the scheduler, another one at each attempt, so that no result of before is taken."""
    return f"asfm-{task.cell.id}-{os.urandom(4).hex()}"


def _wait_for_any(futures: list[Any]) -> list[Any]:
    """Wait until a task ends, but not long: workers may have come."""
    from distributed import wait

    with suppress(TimeoutError):
        wait(futures, timeout=POLL_S, return_when="FIRST_COMPLETED")
    return [future for future in futures if future.done()]


def _collect(future: Any, task: CellTask, queue: TaskQueue, folder: Path) -> None:
    """Take the result of a task; one whose workers died is put back, or its row says so."""
    from distributed import KilledWorker

    path = folder / CELLS / f"{task.cell.id}.parquet"
    if future.cancelled():
        raise AsfmError(describe_loss(None))
    error = future.exception() if future.status == "error" else None
    if isinstance(error, KilledWorker):
        if not path.is_file():
            if has_attempts_left(folder, task.cell.id):
                return queue.put_back(task)
            write_row(path, {**describe_axes(task.cell), "error": DIED})
    elif error is not None:
        why = shorten(f"{type(error).__name__}: {error}", 200)
        raise AsfmError(f"a worker of the cluster cannot run a cell: {why}; expected asfm {__version__} on all of them")
    elif message := future.result():
        raise AsfmError(message)
    _wait_for_row(path)
    queue.finish(task)


def _wait_for_row(path: Path) -> None:
    """Wait until a row that was written on another machine is seen on this one: network disks take their time."""
    deadline_s = time.monotonic() + LONGEST_DELAY_S
    while path.name not in os.listdir(path.parent):  # noqa: PTH208 - reads the folder anew, where a look may be cached
        if time.monotonic() > deadline_s:
            raise AsfmError(f"{path}: a worker has written this file, but not here: expected a folder that is shared")
        time.sleep(0.2)
