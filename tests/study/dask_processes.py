"""A Dask scheduler and workers in processes of their own, on this machine and at ports that are free."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from tests.study.conftest import ROOT

START_S = 60
OPTIONS = ("--no-dashboard", "--dashboard-address", "127.0.0.1:0")


@dataclass
class DaskProcesses:
    """A scheduler and its workers."""

    folder: Path
    address: str
    scheduler: "subprocess.Popen[bytes]"
    workers: "list[subprocess.Popen[bytes]]" = field(default_factory=list)

    def add_worker(self, *modules: Path) -> None:
        """Start a worker of one thread, without a nanny that would start it again; it can import the modules."""
        options = ("--no-nanny", "--nthreads", "1", "--worker-port", "0", "--local-directory", str(self.folder))
        self.workers.append(_start("dask_worker", self.folder, self.address, *options, *OPTIONS, modules=modules))

    def wait_for_workers(self) -> None:
        """Wait until the scheduler knows all workers."""
        from distributed import Client

        if self.workers:
            with Client(self.address, set_as_default=False) as client:
                client.wait_for_workers(len(self.workers), timeout=START_S)


@contextmanager
def start_dask(folder: Path, workers: int, *modules: Path) -> Iterator[DaskProcesses]:
    """Start a scheduler and workers, and end them."""
    file = folder / "scheduler.json"
    options = ("--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file))
    scheduler = _start("dask_scheduler", folder, *options, *OPTIONS)
    dask = None
    try:
        dask = DaskProcesses(folder, _read_address(file), scheduler)
        for _ in range(workers):
            dask.add_worker(*modules)
        dask.wait_for_workers()
        yield dask
    finally:
        for process in [scheduler, *(dask.workers if dask else [])]:
            process.kill()
            process.wait()


def _start(program: str, folder: Path, *arguments: str, modules: tuple[Path, ...] = ()) -> "subprocess.Popen[bytes]":
    path = os.pathsep.join(str(entry) for entry in (ROOT, *modules))
    command = [sys.executable, "-m", f"distributed.cli.{program}", *arguments]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(command, cwd=folder, env={**os.environ, "PYTHONPATH": path}, stdout=quiet, stderr=quiet)


def _read_address(file: Path) -> str:
    deadline_s = time.monotonic() + START_S
    while time.monotonic() < deadline_s:
        try:
            return str(json.loads(file.read_text())["address"])
        except (OSError, ValueError):
            time.sleep(0.05)
    raise TimeoutError("the scheduler has not started")
