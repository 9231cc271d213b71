"""Measured runs of asfm run: one in a child process, and its report and failures."""

from pathlib import Path
from typing import Any

import pytest

from asfm.commands import SimulationOptions, simulate_to
from asfm.evaluation.pose_error_table import ATE_OVER_PATH, ATE_RMSE
from tools.benchmark import runs
from tools.benchmark.__main__ import main


def test_a_run_is_measured_in_a_child(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    simulate_to("tank", tmp_path / "tank", SimulationOptions(sonar="holoocean", frames=3))
    assert main(["run", str(tmp_path / "tank"), "--set", "backend.rounds=1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    shown = {line.split("  ")[0]: line.split() for line in lines}
    assert shown["frames"][-1] == "3"
    ate_m, odometry_m = (float(shown[name][-2]) for name in ("ATE, SE(3)-aligned, no scale", "the odometry's ATE"))
    assert float(shown["ratio"][-1]) == pytest.approx(ate_m / odometry_m, rel=0.1)
    assert float(shown["wall"][-2]) > 0 and 50 < float(shown["peak"][-2]) < 5000
    assert any(line.startswith("stage ") for line in lines)

    monkeypatch.setattr(runs, "PUBLIC_RUNS", (("gone", "gone", ()),))
    assert main(["public", str(tmp_path)]) == 1
    assert "failed" in capsys.readouterr().out
    assert main(["run", str(tmp_path / "gone")]) == 1
    assert "gone: expected a sequence" in capsys.readouterr().err


def test_missing_measures_are_dashes() -> None:
    report = {
        "sequence": {"frames": 6},
        "stages": [],
        "warnings": [{"code": "empty-frames", "message": "little is seen"}],
    }
    unknown = runs.summarise(report, [], 2.0)
    assert runs._cells(unknown) == ("6", "-", "-", "2.0", "0", "1")
    assert runs.describe_run(unknown)[-1] == "warning: little is seen [empty-frames]"
    rows: list[dict[str, Any]] = [{"key": ATE_RMSE, "value": 0.02}, {"key": ATE_OVER_PATH, "value": 1.5}]
    assert runs._cells(runs.summarise(report, rows, 2.0))[1:3] == ("0.0200", "1.50 %")
    rows[0] |= {"odometry": 0.04, "ratio": 0.5}
    assert runs._cells(runs.summarise(report, rows, 2.0))[1:3] == ("0.0200", "0.500 x")


def test_a_failure_is_described_by_its_exception() -> None:
    explain = runs._explain_failure
    trace = "stage: 3 steps\nTraceback (most recent call last):\n  File x\n    call()\n"
    trace += "RuntimeError: \nSingular\nasfm: a defect\n"
    assert explain(1, trace) == "RuntimeError: Singular asfm: a defect"
    assert explain(2, "stage: 3 steps\nasfm: no such file\n") == "asfm: no such file"
    assert explain(-9, "") == "ended with code -9"
