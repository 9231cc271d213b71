"""Evaluation table: rows by key, and the content of evaluation.json."""

import pytest

from asfm.evaluation.evaluation_table import EvaluationRow, EvaluationTable

ROW = EvaluationRow("a_m", "a", 1.5, "m", detail=True)


def test_rows_are_found_by_key() -> None:
    table = EvaluationTable((ROW,), ("a note",))
    assert table.row("a_m") is ROW
    with pytest.raises(KeyError, match="b_m"):
        table.row("b_m")


def test_json_holds_every_field() -> None:
    row = {"key": "a_m", "name": "a", "value": 1.5, "unit": "m", "odometry": None, "ratio": None, "detail": True}
    table = EvaluationTable((ROW,), ("a note",), "poses.tum").as_dict()
    assert table == {"rows": [row], "notes": ["a note"], "reference": "poses.tum"}
