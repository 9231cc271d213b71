"""Restricted unpickler for untrusted files: numpy arrays, numbers, strings, lists, tuples and dicts only.

A pickle is a program that may call whatever its reader lets it look up. Here it can look up numpy's own helpers only,
and gets replacements for them that check their arguments, so that no unchecked byte reaches numpy's internals.
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

from asfm.datasets.holoocean.pickle_opcodes import PickleBoundsError, check_opcodes
from asfm.errors import AsfmError, quote, shorten
from asfm.file_kinds import SNIFFED_BYTES, name_kind
from asfm.regular_file import read_file

MAX_BYTES = 256 << 20
PLAIN_DTYPE = re.compile(r"b1|[iu][1248]|f[248]|[SU]\d{1,4}")
"""Allowed type codes: booleans, integers, floats and strings; no objects, records or dates."""
BYTE_ORDERS = ("<", ">", "|", "=")


class _Refused(Exception):
    """The pickle asks for something that is not allowed."""


def load_pickle(path: Path) -> Any:
    """Load a pickle of numpy arrays and plain values without running code from it.

    Args:
        path: the file.

    Returns:
        The value; arrays are of a subclass of ndarray, so pass them to ``np.asarray``.

    Raises:
        AsfmError: the file cannot be read, is damaged, or asks for a class or function that is not allowed.
    """
    content = read_file(path, "a pickle", MAX_BYTES)
    kind = name_kind(content[:SNIFFED_BYTES])
    if kind is not None:
        raise AsfmError(f"{path}: expected a pickle, found {kind}")
    try:
        check_opcodes(content)
        return _Unpickler(io.BytesIO(content)).load()
    except PickleBoundsError as error:
        raise AsfmError(f"{path}: {error}: no code was run") from None
    except _Refused as refusal:
        raise AsfmError(f"{path}: expected numpy arrays and plain values, found {refusal}: no code was run") from None
    except Exception as error:  # a damaged pickle raises almost anything
        text = shorten(str(error))
        raise AsfmError(f"{path}: expected a pickle, found damaged bytes: {type(error).__name__} {text}") from None


class _AllowedFunction:
    """A function that a pickle may call but not modify: plain functions would accept new attributes."""

    __slots__ = ("_function",)

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    def __call__(self, *arguments: Any) -> Any:
        return self._function(*arguments)

    def __setstate__(self, state: Any) -> None:
        raise _Refused("an attempt to alter a function")


class _Dtype:
    """Replacement of numpy.dtype: created with kind and size, then given the byte order as its state."""

    __slots__ = ("_code", "_order")

    def __init__(self, code: Any, *_flags: Any) -> None:
        if not isinstance(code, str) or not PLAIN_DTYPE.fullmatch(code):
            raise _Refused(f"an array of type {quote(code)}")
        self._code, self._order = code, "="

    def __setstate__(self, state: Any) -> None:
        if not isinstance(state, tuple) or len(state) < 5 or state[1] not in BYTE_ORDERS or any(state[2:5]):
            raise _Refused("an array of records")
        self._order = state[1]

    def resolve(self) -> np.dtype[Any]:
        """Return the numpy dtype."""
        return np.dtype(f"{self._order}{self._code}")


class _PlainArray(np.ndarray[Any, np.dtype[Any]]):
    """Array that validates the state that a pickle gives it."""

    def __setstate__(self, state: Any) -> None:
        _, shape, dtype, is_fortran, content = state
        array = _decode(content, dtype, shape, "F" if is_fortran else "C")
        super().__setstate__((1, array.shape, array.dtype, bool(is_fortran), bytes(content)))  # type: ignore[arg-type]


def _decode(content: Any, dtype: Any, shape: Any, order: Any) -> NDArray[Any]:
    """Make an array from its bytes, and check that type, shape and number of bytes agree."""
    if not isinstance(dtype, _Dtype) or not isinstance(content, bytes | bytearray) or order not in ("C", "F"):
        raise _Refused("an array of Python objects")
    if not (isinstance(shape, tuple) and len(shape) <= 8 and all(type(size) is int and size >= 0 for size in shape)):
        raise _Refused("an array without a proper shape")
    resolved = dtype.resolve()
    if resolved.itemsize == 0 or math.prod(shape) * resolved.itemsize != len(content):
        raise _Refused(f"{len(content)} bytes for an array of shape {quote(shape)}")
    return np.frombuffer(content, dtype=resolved).reshape(shape, order="F" if order == "F" else "C")


def _reconstruct(subtype: Any, _shape: Any, _code: Any) -> _PlainArray:
    if subtype is not NDARRAY:
        raise _Refused("an array of a class other than ndarray")
    return np.ndarray.__new__(_PlainArray, (0,), np.uint8)


def _scalar(dtype: Any, content: Any) -> Any:
    return _decode(content, dtype, (1,), "C")[0]


def _encode(text: Any, encoding: Any) -> bytes:
    """Decode bytes as pickle protocols 0 to 2 write them, as latin1 text."""
    if not isinstance(text, str) or encoding != "latin1":
        raise _Refused("an unusual encoding")
    return text.encode("latin1")


def _empty_bytes() -> bytes:
    """Return empty bytes, which pickle protocols 0 to 2 write as a call without arguments."""
    return b""


NDARRAY = object()
"""Replacement of numpy.ndarray: it can be named, but not called."""

ALLOWED_GLOBALS: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): NDARRAY,
    ("numpy", "dtype"): _AllowedFunction(_Dtype),
    ("_codecs", "encode"): _AllowedFunction(_encode),
    ("__builtin__", "bytes"): _AllowedFunction(_empty_bytes),
    ("builtins", "bytes"): _AllowedFunction(_empty_bytes),
}
for core in ("numpy.core", "numpy._core"):  # numpy 1 and 2
    ALLOWED_GLOBALS[f"{core}.multiarray", "_reconstruct"] = _AllowedFunction(_reconstruct)
    ALLOWED_GLOBALS[f"{core}.multiarray", "scalar"] = _AllowedFunction(_scalar)
    ALLOWED_GLOBALS[f"{core}.numeric", "_frombuffer"] = _AllowedFunction(_decode)


class _Unpickler(pickle.Unpickler):
    def find_class(self, module_name: str, global_name: str) -> Any:
        try:
            return ALLOWED_GLOBALS[module_name, global_name]
        except KeyError:
            raise _Refused(shorten(f"{module_name[:99]}.{global_name[:99]}")) from None
