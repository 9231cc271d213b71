"""Prefetching gives the same results in the same order as map, and errors at their position."""

import threading
import time
from collections.abc import Iterator

import pytest

from asfm.prefetch import prefetch_map


@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_results_are_those_of_map(count: int) -> None:
    assert list(prefetch_map(lambda item: item * item, range(count))) == [item * item for item in range(count)]


def test_work_is_done_in_a_thread_one_item_ahead() -> None:
    done: list[int] = []
    here = threading.get_ident()

    def work(item: int) -> bool:
        done.append(item)
        return threading.get_ident() == here

    for number, in_consumers_thread in enumerate(prefetch_map(work, range(5))):
        assert not in_consumers_thread
        for _ in range(100):
            if len(done) > number + 1 or number == 4:
                break
            time.sleep(0.01)
        assert len(done) == min(number + 2, 5)


def test_errors_are_raised_at_their_position() -> None:
    def work(item: int) -> float:
        return 1 / (2 - item)

    results = prefetch_map(work, range(4))
    assert [next(results), next(results)] == [0.5, 1.0]
    with pytest.raises(ZeroDivisionError):
        next(results)

    def items() -> Iterator[int]:
        yield 1
        raise OSError("gone")

    with pytest.raises(OSError, match="gone"):
        list(prefetch_map(work, items()))


def test_closing_the_iterator_ends_the_thread() -> None:
    before = threading.active_count()
    results = prefetch_map(lambda item: item, range(100))
    next(results)
    results.close()  # type: ignore[attr-defined]
    assert threading.active_count() == before
