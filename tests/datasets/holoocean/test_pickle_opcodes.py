"""Opcodes of pickles: real ticks pass, whatever grows beyond the file is refused before it is loaded."""

import pickle
from typing import Any

import numpy as np
import pytest

from asfm.datasets.holoocean.pickle_opcodes import MAX_DEPTH, MAX_OPCODES, PickleBoundsError, check_opcodes


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_ticks_of_every_protocol_pass(protocol: int) -> None:
    pose = np.eye(4)
    tick = {
        "ImagingSonar": np.random.default_rng(0).random((30, 20), dtype=np.float32),
        "PoseSensor": pose,
        "again": pose,
        "t": 0.25,
        "names": ["a", ("b", 1), {"c": None}],
        "rows": [[float(row + column) for column in range(9)] for row in range(9)],
        "scalar": np.float64(3),
    }
    check_opcodes(pickle.dumps(tick, protocol))


def nest(depth: int, width: int) -> Any:
    value: Any = (1,)
    for _ in range(depth):
        value = (value,) * width
    return value


def contain_itself() -> list[Any]:
    values: list[Any] = []
    values.append([values])
    return values


def frame(size: int) -> bytes:
    return b"\x80\x04\x95" + size.to_bytes(8, "little") + b"N."


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"Nr\xff\xff\xff\x7f.", "places in the memo up to 1, found 2147483647"),
        (b"N(lp99999999\n.", "places in the memo"),
        (frame(1 << 40), "a frame of"),
        (b"\x80\x04}K\x01\x85" + b"2\x86" * 40 + b"K\x01s.", "levels"),
        (pickle.dumps({nest(5, 2): 1}, 4), "names as keys"),
        (pickle.dumps({10**50: 1}, 4), "names as keys"),
        (pickle.dumps(nest(MAX_DEPTH + 1, 1), 4), "levels"),
        (pickle.dumps(nest(8, 30), 4), "again and again"),
        (pickle.dumps([b"x" * 100_000] * 1, 4)[:-2] + b"h\x01a" * 10_000 + b".", "again and again|themselves"),
        (pickle.dumps(contain_itself(), 4), "contain themselves|filled before"),
        (pickle.dumps({1, 2}, 4), "opcode EMPTY_SET"),
        (b"\x80\x04](" + b"N" * MAX_OPCODES + b"e.", "values at most"),
        (b"\x80\x04h\x05.", "a value in the memo at 5, found none"),
        (b"a.", "values on the stack"),
        (b"t.", "a mark on the stack"),
        (b"\x80\x02cos\nsystem\n(X\x01\0\0\0lo.", "opcode OBJ|values on the stack"),
    ],
    ids=range(16),
)
def test_what_grows_is_refused(content: bytes, found: str) -> None:
    with pytest.raises(PickleBoundsError, match=found):
        check_opcodes(content)


@pytest.mark.parametrize("content", [b"\x80\x04\x8e\0\0\0\0\x08\0\0\0.", b"B\xff\xff\xff\x7f.", b"", b"N"])
def test_lengths_beyond_the_end_are_no_pickle(content: bytes) -> None:
    with pytest.raises(ValueError, match=r"expected|exhausted|ended|remain"):
        check_opcodes(content)
