"""``asfm study``: the plan without work, the files of the tools, and what a finished study prints."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from asfm.cli import run_command_line
from asfm.commands import plan_study
from asfm.datasets.native.writer import write_native
from asfm.simulation.simulate import simulate
from asfm.study.study_run import load_grid

Ask = Callable[..., str]
TOOLS = Path(__file__).resolve().parents[2] / "tools"


def test_a_dry_run_prints_the_grid_and_runs_nothing(tmp_path: Path, ask: Ask) -> None:
    path = tmp_path / "study.yaml"
    path.write_text(
        "simulate: {scenes: [tank], sonars: [didson], frames: 10}\nseeds: 2\nmodes: [sonar, all]\n"
        "detectors: [akaze]\nexternal: [{name: mine, function: 'json:loads'}]\ncorruption: {recall: [1, 0.5]}\n"
    )
    lines = ask("study", path, "--dry-run").splitlines()
    found = {line[:20].split("  ")[0].strip(): line for line in lines}
    assert "sonar, all" in found["modes"] and "0, 1" in found["seeds"] and "1.0, 0.5" in found["corruption, recall"]
    assert any(line.startswith("16 cells, 2 sequences, front-end passes: 2; about ") for line in lines)
    assert lines[-1] == "external matcher: the Python function json:loads is code, and it would be run"
    assert [entry.name for entry in tmp_path.iterdir()] == ["study.yaml"]


def test_recordings_without_the_sensors_of_a_mode_are_named_beforehand(tmp_path: Path, ask: Ask) -> None:
    made = simulate("tank", "didson", 2)
    write_native(tmp_path / "bare", replace(made.sequence, odometry=None, navigation=None))
    (tmp_path / "study.yaml").write_text("sequences: [bare]\nmodes: [sonar, odometry, all]\ndetectors: [akaze]\n")
    lines = ask("study", tmp_path / "study.yaml", "--dry-run").splitlines()
    assert lines[-2:] == [
        "cells that would fail: bare: mode odometry needs odometry, found none",
        "cells that would fail: bare: mode all needs odometry, or depth and attitude, found none",
    ]
    assert lines[-3].startswith("3 cells, 1 sequence, front-end passes: 1; about 1 minute on")


def test_a_study_of_which_nothing_succeeds_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = simulate("tank", "didson", 2)
    write_native(tmp_path / "bare", replace(made.sequence, odometry=None, navigation=None))
    (tmp_path / "study.yaml").write_text("sequences: [bare]\nmodes: [odometry]\ndetectors: [akaze]\n")
    results = tmp_path / "out"
    assert run_command_line(["study", str(tmp_path / "study.yaml"), "--output", str(results), "--jobs", "1"]) == 2
    assert "all 1 cells of the study failed, the first one with: bare: mode odometry needs" in capsys.readouterr().err
    assert (results / "report.html").is_file() and (results / "results.csv").is_file()


@pytest.mark.parametrize(("name", "cells"), [("matcher_study", 3870), ("matcher_study_quick", 56)])
def test_the_standing_studies_are_valid(name: str, cells: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """As if the learned matchers were installed."""
    monkeypatch.setattr("asfm.study.grid.check_extra", lambda: None)
    monkeypatch.setattr("asfm.study.grid.version", lambda _: "1")
    study, grid = load_grid(TOOLS / f"{name}.yaml")
    assert len(grid) == len({cell.id for cell in grid}) == cells
    if name == "matcher_study":
        real = sum(cell.corruption is None for cell in grid)
        assert (len(study.detectors) + len(study.learned)) * len(study.filters) * 3 * 2 * 5 * 3 == real
    assert plan_study(TOOLS / f"{name}.yaml").estimate.cells == cells


def test_an_output_is_needed_for_work(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["study", str(TOOLS / "matcher_study_quick.yaml")]) == 2
    assert "expected a folder for the study (--output DIR), or --dry-run" in capsys.readouterr().err
