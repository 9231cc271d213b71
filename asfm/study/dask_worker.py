"""Run of a cell on a Dask worker: one at a time in a process, on one thread, and not again after two deaths."""

import threading
from pathlib import Path

from asfm import __version__
from asfm.errors import AsfmError
from asfm.study.cell_run import CELLS, CellTask
from asfm.study.manifest import MANIFEST
from asfm.study.results_table import describe_axes, write_row
from asfm.study.task_queue import RunTask

ATTEMPTS = "attempts"
"""Folder of a study that has a file for every start of a cell on a cluster."""
MAX_ATTEMPTS = 2
DIED = "the worker process died"
_one_at_a_time = threading.Lock()


def run_on_worker(task: CellTask, folder: Path, run: RunTask, version: str) -> str:
    """Run a task unless its row is there; where it was begun twice and never ended, write that as its row.

    A worker process with several threads runs one cell after the other: the random numbers of OpenCV are those of the
    whole process.

    Args:
        task: the cell.
        folder: of the study, shared by all machines.
        run: runs the task and writes its row.
        version: of the asfm that asks for it.

    Returns:
        What was wrong, such as a row that cannot be written; empty where nothing was.
    """
    import cv2
    from threadpoolctl import threadpool_limits

    if version != __version__:
        return f"a worker of the cluster has asfm {__version__}, this is {version}: expected the same everywhere"
    path = folder / CELLS / f"{task.cell.id}.parquet"
    with _one_at_a_time, threadpool_limits(1):
        cv2.setNumThreads(1)
        try:
            if not (folder / MANIFEST).is_file():
                return f"{folder}: a worker of the cluster does not see this folder: expected one that they share"
            if path.is_file():
                return ""
            if _count_attempt(folder / ATTEMPTS, task.cell.id) > MAX_ATTEMPTS:
                write_row(path, {**describe_axes(task.cell), "error": f"{DIED}, at two attempts"})
            else:
                run(task, folder)
        except AsfmError as error:
            return str(error)
        except OSError as error:
            return f"{folder}: cannot write: {error.strerror}"
    return ""


def _count_attempt(folder: Path, cell: str) -> int:
    """Return the number of this attempt at a cell, of all workers, from 1; those that are too many are not counted."""
    for number in range(1, MAX_ATTEMPTS + 1):
        try:
            (folder / f"{cell}-{number}").open("xb").close()
        except FileExistsError:
            continue
        return number
    return MAX_ATTEMPTS + 1


def has_attempts_left(folder: Path, cell: str) -> bool:
    """Return whether a cell was begun less than twice.

    Args:
        folder: of the study.
        cell: its id.
    """
    return not (folder / ATTEMPTS / f"{cell}-{MAX_ATTEMPTS}").exists()
