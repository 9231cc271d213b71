"""Stand-ins for the run of a cell, which the engine's tests let workers call."""

import os
import signal
import time
from pathlib import Path

from asfm.errors import AsfmError
from asfm.study.cell_run import CELLS, CellTask
from asfm.study.results_table import describe_axes, write_row


def note_process(task: CellTask, folder: Path) -> None:
    """Write a row that holds the process and its threads."""
    time.sleep(0.05)
    threads = os.environ.get("OMP_NUM_THREADS", "as many as cores")
    row = {**describe_axes(task.cell), "warnings": f"{os.getpid()} {threads}"}
    write_row(folder / CELLS / f"{task.cell.id}.parquet", row)


def die_at_seed_2(task: CellTask, folder: Path) -> None:
    """Be killed in the middle of the cell of seed 2."""
    if task.cell.seed == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    note_process(task, folder)


def fill_the_disk(task: CellTask, folder: Path) -> None:
    """Fail as a cell whose row cannot be written."""
    raise AsfmError(f"{folder}: cannot write: No space left on device")


def log_span(task: CellTask, folder: Path) -> None:
    """Write when the cell was begun and ended, with the key of its features."""
    begin_s = time.monotonic()
    time.sleep(0.4)
    row = {**describe_axes(task.cell), "warnings": f"{task.cell.features_key} {begin_s} {time.monotonic()}"}
    write_row(folder / CELLS / f"{task.cell.id}.parquet", row)


def wait_a_second(task: CellTask, folder: Path) -> None:
    """Take one second."""
    time.sleep(1)
    write_row(folder / CELLS / f"{task.cell.id}.parquet", describe_axes(task.cell))
