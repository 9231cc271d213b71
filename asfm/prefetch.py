"""Prefetching: compute the next item in a thread while the consumer works on the current one."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def prefetch_map(work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """Apply a function to items in order, in one background thread, one item ahead of the consumer.

    Saves time where the function releases Python's global lock, as OpenCV and NumPy do. Exceptions of the function or
    of the items reach the consumer at the position of the item that raised them.

    Args:
        work: called in the background thread, one call at a time.
        items: iterated in the consumer's thread.

    Yields:
        The results, in the order of the items.
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
