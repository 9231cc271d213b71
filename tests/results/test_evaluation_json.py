"""evaluation.json: replaced atomically."""

import json
from pathlib import Path

import pytest

from asfm.errors import AsfmError
from asfm.evaluation.evaluation_table import EvaluationRow, EvaluationTable
from asfm.results.evaluation_json import read_evaluation, write_evaluation


def list_rows(**values: float) -> str:
    """Return an evaluation with a value for each key."""
    rows = [{"key": key, "name": key, "unit": "", "value": value} for key, value in values.items()]
    return json.dumps({"rows": rows, "notes": []})


def test_evaluation_is_replaced(tmp_path: Path) -> None:
    for note in ("old", "new"):
        write_evaluation(tmp_path, EvaluationTable((), (note,)))
    assert [path.name for path in tmp_path.iterdir()] == ["evaluation.json"]
    assert json.loads((tmp_path / "evaluation.json").read_text())["notes"] == ["new"]


def test_failed_write_keeps_the_old_evaluation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_evaluation(tmp_path, EvaluationTable((), ("old",)))

    def refuse(self: Path, target: Path) -> Path:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(AsfmError, match=r"evaluation\.json: cannot write: Permission denied"):
        write_evaluation(tmp_path, EvaluationTable((), ("new",)))
    assert [path.name for path in tmp_path.iterdir()] == ["evaluation.json"]
    assert json.loads((tmp_path / "evaluation.json").read_text())["notes"] == ["old"]


def test_an_evaluation_reads_back(tmp_path: Path) -> None:
    rows = (
        EvaluationRow("ate_m", "ATE", 0.1, "m", 0.3, 1 / 3),
        EvaluationRow("match_recall", "recall", 1.0, "", detail=True),
    )
    for table in (EvaluationTable(rows, ("a note",)), EvaluationTable(rows, (), "/poses.tum")):
        write_evaluation(tmp_path, table)
        assert read_evaluation(tmp_path) == table


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "expected an evaluation that asfm wrote"),
        ("[", "cannot read an evaluation"),
        ("[]", "with rows and notes"),
        ('{"rows": [], "notes": [1]}', "with rows and notes"),
        ('{"rows": [3], "notes": []}', "row 0: expected a key, a name and a unit, found 3"),
        ('{"rows": [{"key": "a", "name": "a", "unit": "m"}], "notes": []}', "row 0: expected a value, found none"),
        ('{"rows": [], "notes": []}', "with rows, found none; run asfm evaluate again"),
        (list_rows(match_precision_overall=7.5), r"row 0: expected a share of 0 to 1, found 7\.5"),
        (list_rows(match_recall_gap_1=-0.1), r"row 0: expected a share of 0 to 1, found -0\.1"),
        (list_rows(poses_compared=3, ate_rmse_m_se3=-3), "row 1: expected an error of 0 or more, found -3"),
        (list_rows(ate_m=1, twice=2).replace("twice", "ate_m"), "each key once, found 'ate_m' again"),
        (
            '{"rows": [{"key": "a", "name": "a", "unit": "m", "value": NaN}], "notes": []}',
            "finite number as value, found nan",
        ),
        (
            '{"rows": [{"key": "a", "name": "a", "unit": "m", "value": 1, "ratio": "x"}], "notes": []}',
            "finite number as ratio, found 'x'; run asfm evaluate again",
        ),
    ],
)
def test_a_damaged_evaluation_is_a_one_line_error(tmp_path: Path, content: str | None, message: str) -> None:
    if content is not None:
        (tmp_path / "evaluation.json").write_text(content)
    with pytest.raises(AsfmError, match=message) as caught:
        read_evaluation(tmp_path)
    assert "\n" not in str(caught.value)
