"""Progress of the stages: bars on a terminal, one line per stage elsewhere."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from asfm.cli.terminal import print_progress


@contextmanager
def show_progress() -> Iterator[Callable[[str, int, int], None]]:
    """Show the progress of stages on stderr while the body runs.

    Yields:
        The function to call as progress(stage, done, total).
    """
    if not sys.stderr.isatty():
        yield _make_line_printer()
        return
    from rich import progress as bars
    from rich.console import Console

    columns = (bars.TextColumn("{task.description}"), bars.BarColumn(), bars.MofNCompleteColumn())
    with bars.Progress(*columns, bars.TimeElapsedColumn(), console=Console(stderr=True)) as display:
        tasks: dict[str, bars.TaskID] = {}

        def advance(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = display.add_task(stage, total=total)
            display.update(tasks[stage], completed=done, total=total)

        yield advance


def _make_line_printer() -> Callable[[str, int, int], None]:
    """Return a progress function that prints one line when a stage begins."""
    announced: set[str] = set()

    def announce(stage: str, done: int, total: int) -> None:  # noqa: ARG001 - the signature of Progress
        if stage not in announced:
            announced.add(stage)
            print_progress(f"{stage}: {total} steps")

    return announce


LINE_INTERVAL_S = 30.0
"""Time between two lines of a countdown that is not on a terminal."""


@contextmanager
def show_countdown(name: str) -> Iterator[Callable[[int, int, float], None]]:
    """Show how much of long work is done and the time left, on stderr while the body runs.

    Yields:
        The function to call as report(done, total, seconds left).
    """
    if not sys.stderr.isatty():
        yield _make_countdown_printer(name)
        return
    from rich import progress as bars
    from rich.console import Console

    columns = (bars.TextColumn("{task.description}"), bars.BarColumn(), bars.MofNCompleteColumn())
    with bars.Progress(*columns, bars.TextColumn("{task.fields[left]}"), console=Console(stderr=True)) as display:
        task = display.add_task(name, total=None, left="")

        def advance(done: int, total: int, left_s: float) -> None:
            display.update(task, completed=done, total=total, left=f"{format_duration(left_s)} left")

        yield advance


def format_duration(seconds: float) -> str:
    """Format a duration in seconds, minutes or hours, whichever suits it."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 90 * 60 else f"{seconds / 3600:.1f} h"


def _make_countdown_printer(name: str) -> Callable[[int, int, float], None]:
    """Return a function that prints a line at most every half minute, and one at the end."""
    printed_s = -LINE_INTERVAL_S

    def report(done: int, total: int, left_s: float) -> None:
        nonlocal printed_s
        if done == total or time.monotonic() - printed_s >= LINE_INTERVAL_S:
            printed_s = time.monotonic()
            print_progress(f"{name}: {done} of {total} cells, {format_duration(left_s)} left")

    return report
