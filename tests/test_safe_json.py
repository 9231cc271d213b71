"""JSON: read as by the standard library, and refused where it is deep, ambiguous or endless."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from asfm.errors import AsfmError
from asfm.safe_json import MAX_DEPTH, read_json

VALUES = st.recursive(
    st.none() | st.integers(-(10**20), 10**20) | st.floats(allow_nan=False) | st.text('ab"[]{}\\', max_size=9),
    lambda items: st.lists(items, max_size=3) | st.dictionaries(st.text(max_size=3), items, max_size=3),
    max_leaves=9,
)


@given(VALUES)
def test_values_are_read_back(tmp_path_factory: pytest.TempPathFactory, value: Any) -> None:
    path = tmp_path_factory.getbasetemp() / "value.json"
    path.write_text(json.dumps(value), encoding="utf-8")
    assert read_json(path, "a report") == value


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("{", "Expecting property name"),
        ("", "Expecting value"),
        ('{"a": 1, "b": {"c": 2, "c": 3}}', "expected each key once, found 'c' again"),
        ("[" * (MAX_DEPTH + 1) + "]" * (MAX_DEPTH + 1), "expected 40 levels of brackets at most"),
        ("[" * 100_000, "expected 40 levels of brackets at most"),
        ("9" * 10_000, "expected numbers of 30 digits at most, found 10000 digits"),
        ('"' + "x" * 10**6, "Unterminated string"),
    ],
    ids=range(7),
)
def test_what_cannot_be_used_is_refused(tmp_path: Path, text: str, found: str) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(AsfmError, match=rf"a\.json: cannot read a report: {found}"):
        read_json(tmp_path / "a.json", "a report")
