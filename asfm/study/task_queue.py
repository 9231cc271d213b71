"""Queue of the cells of a study: which one is run next, and how long the rest will take."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from asfm.study.cell_run import CellTask

Report = Callable[[int, int, float], None]
"""Called as report(cells done, all cells, seconds left) after each cell."""
RunTask = Callable[[CellTask, Path], None]
"""Runs a task in the folder of the study, and writes its row."""


class TaskQueue:
    """Tasks in the order of the grid; those whose shared features are being made are put off while there are others."""

    def __init__(self, tasks: Sequence[CellTask], report: Report) -> None:
        """Begin with all tasks to be done."""
        self._pending, self._running, self._made = list(tasks), list[CellTask](), set[str]()
        self._report, self._done, self._total, self._begin_s = report, 0, len(tasks), time.monotonic()

    @property
    def is_empty(self) -> bool:
        """Whether nothing is left to be begun."""
        return not self._pending

    def take(self) -> CellTask:
        """Return the first task that need not wait for what another one is making, or else the first."""
        being_made = {key for task in self._running for key in _list_shared(task)} - self._made
        free = (number for number, task in enumerate(self._pending) if not _list_shared(task) & being_made)
        task = self._pending.pop(next(free, 0))
        self._running.append(task)
        return task

    def put_back(self, task: CellTask) -> None:
        """Put a task that was lost before the others."""
        self._running.remove(task)
        self._pending.insert(0, task)

    def finish(self, task: CellTask) -> None:
        """Note that a task is done, and report the progress."""
        self._running.remove(task)
        self._made |= _list_shared(task)
        self._done += 1
        spent_s = time.monotonic() - self._begin_s
        self._report(self._done, self._total, spent_s / self._done * (self._total - self._done))


def _list_shared(task: CellTask) -> frozenset[str]:
    """Return the keys of what is made once for several cells."""
    return frozenset({task.cell.sequence_key, task.cell.features_key})
