"""Work on what comes next while the consumer is busy with what came before."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def prefetch_map(work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """Apply a function to items in their order, in one thread beside the consumer, one item ahead of it.

    Pays where the function lets go of Python's lock, as OpenCV and numpy do. What the function or the items raise
    reaches the consumer in its turn.

    Args:
        work: called in the thread, never twice at once.
        items: read in the consumer's thread.
    """
    with ThreadPoolExecutor(max_workers=1) as pool:
        pending: Future[Result] | None = None
        for item in items:
            ahead = pool.submit(work, item)
            if pending is not None:
                yield pending.result()
            pending = ahead
        if pending is not None:
            yield pending.result()
