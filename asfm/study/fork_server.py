"""Fork server of worker processes: a process that has loaded the libraries, of which workers are forked at once."""

import multiprocessing
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
PRELOADED = ["asfm.study.cell_run", "pyarrow.json", "pyarrow.parquet"]


def start_fork_server() -> None:
    """Let the fork server load its libraries from now on, beside what this process does; where there is one, nothing.

    It ends with this process.
    """
    context = get_worker_context()
    if context.get_start_method() == "forkserver":
        from multiprocessing import forkserver

        with limit_threads(), _block_interrupt():
            forkserver.ensure_running()


def get_worker_context() -> Any:
    """Return the way of starting processes: libraries with threads do not survive a fork of this one."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    return context


@contextmanager
def limit_threads() -> Iterator[None]:
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


@contextmanager
def _block_interrupt() -> Iterator[None]:
    """Block SIGINT: the server inherits that, and a Ctrl-C while it loads its libraries gives no traceback."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
