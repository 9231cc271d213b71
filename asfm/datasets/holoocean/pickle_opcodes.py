"""Opcodes of a pickle, checked before it is loaded: sizes, memo, nesting and number of values are bounded.

A pickle is a program for a stack machine. A few bytes may reserve gigabytes (a memo index, a length), build values that
contain themselves, or nest tuples in pairs, so that the time to hash or compare them doubles with every byte.
"""

import pickletools
from typing import Any

MAX_OPCODES = 600_000
"""A tick of HoloOcean with a dozen sensors has some hundred; an image as nested lists has one per pixel."""
MAX_DEPTH = 12
"""Levels of containers within one another."""
MAX_WORK = (50, 1_000_000)
"""Bytes that are moved into containers, over the size of the pickle: the factor, and what is allowed besides."""

MARKED = {"LIST", "TUPLE", "DICT"}
"""Opcodes that make a container of all values above the mark."""
TUPLES = {"EMPTY_TUPLE": 0, "TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}
EMPTY = {"EMPTY_LIST", "EMPTY_DICT"}
FILL = {"APPEND": 1, "SETITEM": 2}
FILL_MARKED = {"APPENDS", "SETITEMS"}
KEYED = {"SETITEM", "SETITEMS", "DICT"}
KEYS = {"SHORT_BINUNICODE", "BINUNICODE", "UNICODE", "SHORT_BINSTRING", "BINSTRING", "STRING", "BININT1", "BININT"}
"""Opcodes of values that can be keys: their hash costs nothing."""
MEMO_PUTS, MEMO_GETS = {"PUT", "BINPUT", "LONG_BINPUT"}, {"GET", "BINGET", "LONG_BINGET"}
REFUSED = {
    *("PERSID", "BINPERSID", "EXT1", "EXT2", "EXT4", "INST", "OBJ", "NEWOBJ", "NEWOBJ_EX", "NEXT_BUFFER"),
    *("READONLY_BUFFER", "EMPTY_SET", "ADDITEMS", "FROZENSET"),
}
"""Opcodes that no array and no plain value needs."""


class PickleBoundsError(Exception):
    """The pickle is beyond a bound; the message says what was expected and found."""


class _Value:
    """What is known of a value on the stack: levels, bytes, whether it is held by another, whether it can be a key."""

    __slots__ = ("depth", "is_held", "is_key", "size")

    def __init__(self, size: int = 1, is_key: bool = False) -> None:
        self.depth, self.size, self.is_held, self.is_key = 0, size, False, is_key

    def hold(self, items: "list[_Value]") -> int:
        """Take up items, and return their size."""
        if self.is_held and items:
            raise PickleBoundsError("expected containers that are filled before they are used, found another order")
        for item in items:
            if item is self:
                raise PickleBoundsError("expected values that do not contain themselves, found one that does")
            item.is_held = True
            self.depth = max(self.depth, item.depth + 1)
        if self.depth > MAX_DEPTH:
            raise PickleBoundsError(f"expected {MAX_DEPTH} levels of values at most, found more")
        added = sum(item.size for item in items)
        self.size += added
        return added


def check_opcodes(content: bytes) -> None:
    """Run the stack machine of a pickle on the sizes of values alone.

    Args:
        content: the whole pickle.

    Raises:
        PickleBoundsError: it is beyond a bound.
        ValueError: it is cut off, or holds a byte that is no opcode.
    """
    machine = _Machine(len(content))
    for number, (opcode, argument, _) in enumerate(pickletools.genops(content)):
        if number >= MAX_OPCODES:
            raise PickleBoundsError(f"expected {MAX_OPCODES} values at most, found more")
        machine.step(opcode.name, argument)


class _Machine:
    def __init__(self, size: int) -> None:
        self._size = size
        self._stack: list[_Value | None] = []
        """None is a mark."""
        self._memo: dict[int, _Value] = {}
        self._work = 0

    def step(self, name: str, argument: Any) -> None:
        """Follow one opcode."""
        if name in REFUSED:
            raise PickleBoundsError(f"expected numpy arrays and plain values, found the opcode {name}")
        if name in MEMO_PUTS or name == "MEMOIZE":
            self._remember(len(self._memo) if name == "MEMOIZE" else argument)
        elif name in MEMO_GETS:
            self._recall(argument)
        elif name == "MARK":
            self._stack.append(None)
        elif name in FILL_MARKED or name in MARKED or name in TUPLES or name in EMPTY or name in FILL:
            self._contain(name)
        elif name in ("REDUCE", "BUILD"):
            items = self._pop(2)
            self._hold(_Value() if name == "REDUCE" else items[0], items[1:])
        elif name == "STACK_GLOBAL":
            self._hold(_Value(), self._pop(2))
        elif name in ("POP", "POP_MARK"):
            self._pop_mark() if name == "POP_MARK" else self._pop(1, or_mark=True)
        elif name == "DUP":
            self._stack.append(self._pop(1)[0])
            self._stack.append(self._stack[-1])
        elif name == "FRAME" and argument > self._size:
            raise PickleBoundsError(f"expected a frame of {self._size} bytes at most, found {argument}")
        elif name not in ("PROTO", "FRAME", "STOP"):
            size = len(argument) if isinstance(argument, str | bytes | bytearray) else 8
            self._stack.append(_Value(1 + size, name in KEYS))

    def _remember(self, index: int) -> None:
        if not 0 <= index <= len(self._memo) + 1:
            raise PickleBoundsError(f"expected places in the memo up to {len(self._memo) + 1}, found {index}")
        value = self._pop(1)[0]
        self._memo[index] = value
        self._stack.append(value)

    def _recall(self, index: int) -> None:
        if index not in self._memo:
            raise PickleBoundsError(f"expected a value in the memo at {index}, found none")
        self._stack.append(self._memo[index])

    def _contain(self, name: str) -> None:
        """Make or fill a list, a tuple or a dictionary."""
        if name in EMPTY:
            self._stack.append(_Value())
            return
        if name in TUPLES:
            items = self._pop(TUPLES[name])
        else:
            items = self._pop(FILL[name]) if name in FILL else self._pop_mark()
        if name in KEYED and (len(items) % 2 or not all(item.is_key for item in items[::2])):
            raise PickleBoundsError("expected names as keys, found other values")
        self._hold(_Value() if name in TUPLES or name in MARKED else self._pop(1)[0], items)

    def _hold(self, owner: _Value, items: list[_Value]) -> None:
        """Push a value that takes up items."""
        self._work += owner.hold(items)
        if self._work > MAX_WORK[0] * self._size + MAX_WORK[1]:
            raise PickleBoundsError("expected each value about once, found the same ones again and again")
        self._stack.append(owner)

    def _pop(self, count: int, or_mark: bool = False) -> list[_Value]:
        items = self._stack[len(self._stack) - count :] if count else []
        if len(self._stack) < count or (None in items and not or_mark):
            raise PickleBoundsError("expected values on the stack, found none")
        del self._stack[len(self._stack) - count :]
        return [item for item in items if item is not None]

    def _pop_mark(self) -> list[_Value]:
        for position in range(len(self._stack) - 1, -1, -1):
            if self._stack[position] is None:
                items = self._stack[position + 1 :]
                del self._stack[position:]
                return [item for item in items if item is not None]
        raise PickleBoundsError("expected a mark on the stack, found none")
