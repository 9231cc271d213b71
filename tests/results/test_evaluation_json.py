"""evaluation.json: replaced atomically."""

import json
from pathlib import Path

import pytest

from asfm.errors import AsfmError
from asfm.evaluation.evaluation_table import EvaluationTable
from asfm.results.evaluation_json import write_evaluation


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
