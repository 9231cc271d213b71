"""Restricted unpickler: what it loads, and that hostile pickles are refused without running code."""

import builtins
import collections
import datetime
import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from asfm.datasets.holoocean.safe_pickle import load_pickle
from asfm.errors import AsfmError


@pytest.mark.parametrize("protocol", range(6))
def test_every_protocol_of_numpy_pickles_is_read(tmp_path: Path, protocol: int) -> None:
    values = {
        "f4": np.linspace(0, 1, 12, dtype="<f4").reshape(3, 4),
        "big": np.arange(6, dtype=">i2").reshape(2, 3),
        "fortran": np.asfortranarray(np.arange(12.0).reshape(3, 4)),
        "strided": np.arange(12.0).reshape(3, 4)[:, ::2],
        "bool": np.array([True, False]),
        "text": np.array(["a", "bc"]),
        "empty": np.zeros((0, 3)),
        "scalar": np.float64(2.5),
        "zero_d": np.array(7),
        "plain": [1, (2.5, None, True), "x", {"y": b"z"}],
    }
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps(values, protocol=protocol))
    found = load_pickle(path)
    assert list(found) == list(values) and found["plain"] == values["plain"]
    for name, value in values.items():
        if name != "plain":
            np.testing.assert_array_equal(np.asarray(found[name]), value)
            assert np.asarray(found[name]).dtype.newbyteorder("=") == np.asarray(value).dtype.newbyteorder("=")


def test_names_of_numpy_1_and_2_are_both_read(tmp_path: Path) -> None:
    content = pickle.dumps(np.arange(3.0), protocol=0)
    assert b"numpy._core" in content or b"numpy.core" in content
    for name in (b"numpy._core", b"numpy.core"):
        path = tmp_path / "a.pkl"
        path.write_bytes(content.replace(b"numpy._core", b"numpy.core").replace(b"numpy.core", name))
        np.testing.assert_array_equal(np.asarray(load_pickle(path)), np.arange(3.0))


@given(npst.arrays(npst.scalar_dtypes(), npst.array_shapes(max_dims=3, max_side=4)), st.integers(2, 5))
@settings(max_examples=40, deadline=None)
def test_any_array_is_loaded_unchanged_or_refused(
    tmp_path_factory: pytest.TempPathFactory, array: np.ndarray, protocol: int
) -> None:
    path = tmp_path_factory.mktemp("any") / "a.pkl"
    path.write_bytes(pickle.dumps(array, protocol=protocol))
    if array.dtype.kind in "biufSU":
        np.testing.assert_array_equal(np.asarray(load_pickle(path)), array)
    else:
        with pytest.raises(AsfmError, match="expected numpy arrays and plain values"):
            load_pickle(path)


class Call:
    """Object that pickles as a call of any function with any arguments."""

    def __init__(self, function: Any, *arguments: Any) -> None:
        self.parts = (function, arguments)

    def __reduce__(self) -> Any:
        return self.parts


def forge(name: str, *arguments: Any) -> bytes:
    """Return a protocol 2 pickle that calls module.name, which need not exist here."""
    module, _, function = name.rpartition(".")
    head = b"\x80\x02c" + module.encode() + b"\n" + function.encode() + b"\n"
    return head + pickle.dumps(arguments, protocol=2)[2:-1] + b"R."


class Sub(np.ndarray):
    """An array of another class."""


HOSTILE = {
    "os.system": Call(os.system, "touch OWNED"),
    "eval": Call(builtins.eval, "open('OWNED', 'w')"),
    "exec": Call(builtins.exec, "open('OWNED', 'w')"),
    "open": Call(open, "OWNED", "w"),
    "getattr chain": Call(getattr, Call(getattr, Call(__import__, "os"), "path"), "join"),
    "numpy.load": Call(np.load, "OWNED"),
    "numpy.memmap": Call(np.memmap, "OWNED", "u1", "w+", 0, (4,)),
    "ordered dict": collections.OrderedDict(a=1),
    "date": datetime.date(2020, 1, 1),
    "subclass of ndarray": np.arange(3).view(Sub),
    "object array": np.array([{"a": 1}, None], dtype=object),
    "object array with a call": np.array([Call(os.system, "touch OWNED")], dtype=object),
    "record array": np.zeros(2, dtype=[("a", "f4"), ("b", "O")]),
    "dates": np.array(["2020-01-01"], dtype="M8[D]"),
    "sub-array type": np.dtype(("f4", (2,))),
}
FORGED = {
    "ndarray called": forge("numpy.ndarray", (10**9,)),
    "other class": forge("numpy.core.multiarray._reconstruct", dict, (0,), b"b"),
    "dtype of code": forge("numpy.dtype", "f4,O"),
    "huge dtype": forge("numpy.dtype", "V99999999999"),
    "dotted name": b"\x80\x04\x8c\x05numpy\x8c\x0ef2py.os.system\x93.",
    "encoding": forge("_codecs.encode", "x", "zip"),
    "alter a function": b"\x80\x02cnumpy\ndtype\n}X\x01\x00\x00\x00ai\x01b.",
    "state of an array": forge("numpy._core.multiarray._reconstruct", 1)[:-1] + b"]b.",
    "persistent": b"\x80\x02X\x01\x00\x00\x00aQ.",
    "extension": b"\x80\x02\x82\x01.",
    "nothing": b"",
    "cut off": pickle.dumps(np.arange(100.0))[:-30],
    "text": b"hello",
    "deep": b"\x80\x02" + b"(" * 5000 + b"l" * 10,
}


@pytest.mark.parametrize("name", [*HOSTILE, *FORGED])
def test_a_hostile_pickle_is_refused_and_runs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    content = FORGED[name] if name in FORGED else pickle.dumps({"ImagingSonar": HOSTILE[name]})
    (tmp_path / "evil.pkl").write_bytes(content)
    with pytest.raises(AsfmError, match=r"evil\.pkl: expected") as error:
        load_pickle(tmp_path / "evil.pkl")
    assert "\n" not in str(error.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["evil.pkl"]


def test_the_refusal_names_file_and_class(tmp_path: Path) -> None:
    (tmp_path / "evil.pkl").write_bytes(pickle.dumps(Call(os.system, "touch OWNED")))
    with pytest.raises(AsfmError, match=rf"evil\.pkl: .*{os.system.__module__}\.system"):
        load_pickle(tmp_path / "evil.pkl")


def test_a_hostile_pickle_cannot_modify_the_unpickler(tmp_path: Path) -> None:
    """The BUILD opcode must not change an allowed function for later pickles."""
    path = tmp_path / "a.pkl"
    path.write_bytes(b"\x80\x02cnumpy\ndtype\nN}X\x09\x00\x00\x00_functionX\x01\x00\x00\x00xs\x86b.")
    with pytest.raises(AsfmError, match="alter a function"):
        load_pickle(path)
    path.write_bytes(pickle.dumps(np.arange(3)))
    np.testing.assert_array_equal(np.asarray(load_pickle(path)), np.arange(3))
