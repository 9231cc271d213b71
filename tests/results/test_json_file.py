"""JSON files: strict, sorted, and errors that name the key."""

import json
from pathlib import Path

import numpy as np
import pytest

from asfm.errors import AsfmError
from asfm.results.json_file import write_json


def test_json_is_strict_and_sorted(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    report = {"b": np.float64(0.5), "a": {"n": np.int64(3), "l": np.arange(2), "p": Path("x"), "t": (True, None, "ö")}}
    write_json(path, report)
    text = path.read_text(encoding="utf-8")
    assert text.index('"a"') < text.index('"b"') and "ö" in text and text.endswith("}\n")
    assert json.loads(text) == {"b": 0.5, "a": {"n": 3, "l": [0, 1], "p": "x", "t": [True, None, "ö"]}}


@pytest.mark.parametrize("bad", [float("nan"), np.float32("inf"), np.array([0.0, np.nan]), object()])
def test_value_that_is_not_json_is_named_by_its_key(tmp_path: Path, bad: object) -> None:
    with pytest.raises(ValueError, match=r"report\.stages\[0\]\.seconds"):
        write_json(tmp_path / "report.json", {"stages": [{"seconds": bad}]})
    assert not list(tmp_path.iterdir())


def test_unwritable_folder_is_a_one_line_error(tmp_path: Path) -> None:
    with pytest.raises(AsfmError, match=r"^[^\n]*none/report.json: cannot write: [^\n]*$"):
        write_json(tmp_path / "none" / "report.json", {})
