"""YAML of plain values: everything that could grow, hide or run is refused in one line that names the place."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from asfm.errors import AsfmError
from asfm.safe_yaml import MAX_DEPTH, parse_yaml, read_yaml

PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**9), 10**9)
    | st.floats(allow_nan=False)
    | st.text("abc &*!\n", max_size=9),
    lambda items: st.lists(items, max_size=3) | st.dictionaries(st.text("abcd", min_size=1), items, max_size=3),
    max_leaves=9,
)


@given(PLAIN)
def test_plain_values_are_read_as_by_pyyaml(value: Any) -> None:
    text = yaml.safe_dump(value)
    if "&" not in text:
        assert parse_yaml(text, "here") == yaml.safe_load(text)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("a: &x 1\nb: *x\n", "line 1: .*an anchor or alias"),
        ("a: 1\nb: &y [1]\n", "line 2: .*an anchor or alias"),
        ("a: !!int 3", "line 1: .*the tag 'tag:yaml.org,2002:int'"),
        ("a: !!python/object:os.system {}", "line 1: .*the tag"),
        ("a: 1\nb: 2\na: 3\n", "line 3: expected each key once, found 'a' again"),
        ("a: {c: 1, c: 2}", "expected each key once, found 'c' again"),
        ("<<: {a: 1}", "expected a name as key"),
        ("[1]: 2", "expected a name as key"),
        ("[" * (MAX_DEPTH + 1) + "]" * (MAX_DEPTH + 1), "expected 16 levels at most"),
        ("[" * 100_000, "expected 16 levels at most|exceeded|nest|line 1"),
        ("[" + "1," * 100_001 + "]", "expected 100000 values at most"),
        ("a: " + "9" * 10_000, "expected a value of 1000 characters at most, found 10000"),
        ("a: " + "1:" * 600 + "1", "1000 characters at most"),
        ("a: 2020-99-99", "month must be in 1..12"),
        ("a: [", "line"),
        ("--- 1\n--- 2", "single document|another document"),
    ],
    ids=range(16),
)
def test_what_is_not_plain_is_refused(text: str, found: str) -> None:
    with pytest.raises(AsfmError, match=rf"^here: .*{found}|^here: {found}") as caught:
        parse_yaml(text, "here")
    assert len(str(caught.value)) < 250


def test_files_are_named(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("a: 1\n")
    assert read_yaml(tmp_path / "a.yaml", "the settings") == {"a": 1}
    (tmp_path / "a.yaml").write_bytes(b"#" * (5 << 20))
    with pytest.raises(AsfmError, match=r"a\.yaml: expected the settings of 4194304 bytes at most, found 5242880"):
        read_yaml(tmp_path / "a.yaml", "the settings")
