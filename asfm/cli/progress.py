"""Progress of the stages: bars on a terminal, one line per stage elsewhere."""

import sys
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
