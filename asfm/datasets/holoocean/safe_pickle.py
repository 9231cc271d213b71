"""Unpickle numpy arrays, numbers, strings, lists, tuples, dicts, and nothing else.

A pickle is a program: it may call whatever its reader lets it look up. Here it may look up numpy's own helpers only,
and gets stand-ins for them that check their arguments, so that no stranger's byte reaches numpy's internals unchecked.
"""

import io
import math
import pickle
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.errors import AsfmError

PLAIN_DTYPE = re.compile(r"[biufSU]\d{1,6}")
"""Booleans, integers, floats, strings; no objects, no records, no dates."""
BYTE_ORDERS = ("<", ">", "|", "=")


class _Refused(Exception):
    """The pickle asks for something that is not admitted."""


def load_pickle(path: Path) -> Any:
    """Read a pickle of numpy arrays and plain values; arrays come as a subclass of ndarray, so pass them to np.asarray.

    Raises:
        AsfmError: the file cannot be read, is damaged, or asks for a class or function that is not admitted.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise AsfmError(f"{path}: cannot read the pickle: {error.strerror}") from None
    try:
        return _Unpickler(io.BytesIO(content)).load()
    except _Refused as refusal:
        raise AsfmError(f"{path}: expected numpy arrays and plain values, found {refusal}: nothing was run") from None
    except Exception as error:  # a damaged pickle raises almost anything
        text = " ".join(str(error).split())[:120]
        raise AsfmError(f"{path}: expected a pickle, found damaged bytes: {type(error).__name__} {text}") from None


class _Admitted:
    """A function that a pickle may call but not alter: functions of a module would accept new attributes."""

    __slots__ = ("_function",)

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    def __call__(self, *arguments: Any) -> Any:
        return self._function(*arguments)

    def __setstate__(self, state: Any) -> None:
        raise _Refused("an attempt to alter a function")


class _Dtype:
    """Stand-in of numpy.dtype: the kind and size first, the byte order later."""

    __slots__ = ("_code", "_order")

    def __init__(self, code: Any, *flags: Any) -> None:
        if not isinstance(code, str) or not PLAIN_DTYPE.fullmatch(code):
            raise _Refused(f"an array of type {str(code)[:40]!r}")
        self._code, self._order = code, "="

    def __setstate__(self, state: Any) -> None:
        if not isinstance(state, tuple) or len(state) < 5 or state[1] not in BYTE_ORDERS or any(state[2:5]):
            raise _Refused("an array of records")
        self._order = state[1]

    def resolve(self) -> np.dtype[Any]:
        """Make the real dtype."""
        return np.dtype(f"{self._order}{self._code}")


class _PlainArray(np.ndarray[Any, np.dtype[Any]]):
    """An array that checks the state that a pickle gives it."""

    def __setstate__(self, state: Any) -> None:
        _, shape, dtype, is_fortran, content = state
        array = _decode(content, dtype, shape, "F" if is_fortran else "C")
        super().__setstate__((1, array.shape, array.dtype, bool(is_fortran), bytes(content)))  # type: ignore[arg-type]


def _decode(content: Any, dtype: Any, shape: Any, order: Any) -> NDArray[Any]:
    if not isinstance(dtype, _Dtype) or not isinstance(content, bytes | bytearray) or order not in ("C", "F"):
        raise _Refused("an array of Python objects")
    if not (isinstance(shape, tuple) and len(shape) <= 8 and all(type(size) is int and size >= 0 for size in shape)):
        raise _Refused("an array without a proper shape")
    resolved = dtype.resolve()
    if resolved.itemsize == 0 or math.prod(shape) * resolved.itemsize != len(content):
        raise _Refused(f"{len(content)} bytes for an array of shape {shape}")
    return np.frombuffer(content, dtype=resolved).reshape(shape, order="F" if order == "F" else "C")


def _reconstruct(subtype: Any, shape: Any, code: Any) -> _PlainArray:
    if subtype is not NDARRAY:
        raise _Refused("an array of a class other than ndarray")
    return np.ndarray.__new__(_PlainArray, (0,), np.uint8)


def _scalar(dtype: Any, content: Any) -> Any:
    return _decode(content, dtype, (1,), "C")[0]


def _encode(text: Any, encoding: Any) -> bytes:
    """How protocols 0 to 2 write bytes."""
    if not isinstance(text, str) or encoding != "latin1":
        raise _Refused("an unusual encoding")
    return text.encode("latin1")


def _empty_bytes() -> bytes:
    """How protocols 0 to 2 write no bytes at all."""
    return b""


NDARRAY = object()
"""Stand-in of numpy.ndarray: it can be named, but neither called nor made."""

ADMITTED: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): NDARRAY,
    ("numpy", "dtype"): _Admitted(_Dtype),
    ("_codecs", "encode"): _Admitted(_encode),
    ("__builtin__", "bytes"): _Admitted(_empty_bytes),
    ("builtins", "bytes"): _Admitted(_empty_bytes),
}
for core in ("numpy.core", "numpy._core"):  # numpy 1 and 2
    ADMITTED[f"{core}.multiarray", "_reconstruct"] = _Admitted(_reconstruct)
    ADMITTED[f"{core}.multiarray", "scalar"] = _Admitted(_scalar)
    ADMITTED[f"{core}.numeric", "_frombuffer"] = _Admitted(_decode)


class _Unpickler(pickle.Unpickler):
    def find_class(self, module_name: str, global_name: str) -> Any:
        try:
            return ADMITTED[module_name, global_name]
        except KeyError:
            raise _Refused(f"{module_name}.{global_name}"[:120]) from None
