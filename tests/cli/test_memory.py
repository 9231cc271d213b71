"""Too little memory, in the words of every library."""

import errno

import numpy as np
import pytest

from asfm.cli.memory import MemoryReserve, has_memory_limit, is_out_of_memory
from asfm.errors import AsfmError


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        OSError(errno.ENOMEM, "Cannot allocate memory"),
        RuntimeError("std::bad_alloc"),
        RuntimeError("can't start new thread"),
        ImportError("libarrow.so: failed to map segment from shared object"),
        ValueError("(-4:Insufficient memory) Failed to allocate 12345 bytes in function 'OutOfMemoryError'"),
    ],
)
def test_it_is_recognised_also_as_the_cause(error: Exception) -> None:
    assert is_out_of_memory(error)
    outer = ValueError("cannot read")
    outer.__cause__ = error
    assert is_out_of_memory(outer)


def test_numpy_is_recognised() -> None:
    with pytest.raises(MemoryError) as caught:
        np.empty((1 << 45, 1 << 10), np.uint8)
    assert is_out_of_memory(caught.value)


def test_other_errors_are_not() -> None:
    for error in (ValueError("a bug"), AsfmError("out of memory.png: not found"), FileNotFoundError(2, "none"), None):
        assert not is_out_of_memory(error)


def test_a_reserve_is_given_back_once_and_limits_are_seen() -> None:
    reserve = MemoryReserve()
    reserve.release()
    reserve.release()
    resource = pytest.importorskip("resource")
    assert has_memory_limit() == any(
        resource.getrlimit(kind)[0] != resource.RLIM_INFINITY for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA)
    )
