"""Engines of a study: the processes of this machine, a Dask scheduler that runs, or a cluster that is started."""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

from asfm.errors import AsfmError
from asfm.study.cell_run import CellTask
from asfm.study.task_queue import Report, RunTask

Engine = Callable[[Sequence[CellTask], Path, RunTask, Report], None]
"""Runs tasks in the folder of a study: engine(tasks, folder, run, report)."""


def choose_engine(jobs: int | None = None, scheduler: str | None = None, cluster: Path | None = None) -> Engine:
    """Return what runs the cells; nothing is started yet.

    Args:
        jobs: number of processes of this machine; that of its cores where all three are None.
        scheduler: address of a Dask scheduler.
        cluster: cluster file.

    Raises:
        AsfmError: more than one is given, the number or the address is wrong, the cluster file is at fault, or the
            extra ``cluster`` is not installed.
    """
    given = {"--jobs": jobs, "--scheduler": scheduler, "--cluster": cluster}
    names = [name for name, value in given.items() if value is not None]
    if len(names) > 1:
        raise AsfmError(f"expected one of --jobs, --scheduler and --cluster, found {' and '.join(names)}")
    if scheduler is None and cluster is None:
        return partial(_run_here, _check_jobs(jobs))
    from asfm.study.dask_client import check_address, require_distributed

    require_distributed()
    if scheduler is not None:
        check_address(scheduler)
        return partial(_run_on_dask, partial(_connect, scheduler))
    assert cluster is not None
    from asfm.study.cluster_file import read_cluster

    return partial(_run_on_dask, partial(_start, cluster, read_cluster(cluster)))


def _check_jobs(jobs: int | None) -> int:
    if jobs is not None and jobs < 1:
        raise AsfmError(f"expected at least one process (--jobs), found {jobs}")
    return jobs or os.cpu_count() or 1


def _run_here(jobs: int, tasks: Sequence[CellTask], folder: Path, run: RunTask, report: Report) -> None:
    from asfm.study.local_engine import run_tasks

    run_tasks(tasks, folder, jobs, run, report)


def _run_on_dask(connect: Any, tasks: Sequence[CellTask], folder: Path, run: RunTask, report: Report) -> None:
    from asfm.study.dask_engine import run_tasks_on_dask

    run_tasks_on_dask(tasks, folder, connect, run, report)


@contextmanager
def _connect(address: str) -> Iterator[tuple[Any, float]]:
    from asfm.study.dask_client import NO_WORKER_S, open_client

    with open_client(address) as client:
        yield client, NO_WORKER_S


@contextmanager
def _start(path: Path, settings: Any) -> Iterator[tuple[Any, float]]:
    """Start a cluster; its jobs may wait in their queue for as long as they have to."""
    from asfm.study.cluster_file import start_cluster
    from asfm.study.dask_client import open_client

    with start_cluster(path, settings) as cluster, open_client(cluster) as client:
        yield client, inf
