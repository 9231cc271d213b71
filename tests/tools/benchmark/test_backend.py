"""Requirements on the back-end, on tiny sequences and on made-up runs."""

from pathlib import Path

import numpy as np
import pytest

from tools.benchmark import simulated_cases
from tools.benchmark.__main__ import main
from tools.benchmark.accuracy import Accuracy, describe_accuracy
from tools.benchmark.backend import Task, list_backend_numbers, nees_interval
from tools.benchmark.simulated_cases import Case


def test_the_nees_interval_holds_95_percent_of_all_means() -> None:
    low, high = nees_interval(10)
    means = np.mean(np.random.default_rng(0).normal(size=(4000, 30)) ** 2, axis=1)
    assert np.mean((means > low) & (means < high)) == pytest.approx(0.95, abs=0.015)
    assert low < 1 < high


def test_means_and_worst_runs_are_compared_with_the_requirements() -> None:
    task = Task(Case("pier", "didson", 0, 8), ("odometry",))
    runs = [(task, Accuracy(f"run{n}", "odometry", ate_m=ate, odometry_ate_m=1.0)) for n, ate in enumerate([0.3, 1.1])]
    runs.append((task, Accuracy("lost", "sonar", ate_m=0.2, path_m=1.0)))
    runs.append((task, Accuracy("flagged", "sonar", ate_m=0.3, path_m=1.0, flagged=True)))
    runs.append((task, Accuracy("broken", "odometry", failure="ValueError: no")))
    numbers = {number.what: number for number in list_backend_numbers(runs)}
    assert numbers["runs that failed"].ok is False
    mean, worst = numbers["odometry, ATE / odometry, mean of 2"], numbers["odometry, ATE / odometry, worst: run1"]
    assert mean.reached == pytest.approx(0.7)
    assert (mean.ok, worst.reached, worst.ok) == (True, 1.1, False)
    flagged = numbers["sonar alone, ATE above 10 % of the path: share flagged, of 2"]
    assert (flagged.reached, flagged.ok) == (0.5, False)
    assert numbers["sonar, ATE / path, mean of 2"].reached == pytest.approx(0.25)
    assert "failed: ValueError: no" in describe_accuracy(runs[-1][1])


def test_every_line_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One scene and one sonar in all modes, the narrow sonar, and errors."""
    monkeypatch.setattr(simulated_cases, "SPEED_FACTORS", (4.0,))
    few = ["--frames", "5", "--seeds", "1", "--cache", str(tmp_path), "--set", "backend.rounds=1"]
    command = ["backend", "--scenes", "tank", "--sonars", "didson", *few]
    assert main(command) == 1, "five frames do not meet every requirement"
    lines = capsys.readouterr().out.splitlines()
    runs, table = lines[: lines.index("")], lines[lines.index("") + 1 :]
    assert [line.split(":")[0].split(", ")[-1] for line in runs] == ["navigation", "odometry", "sonar", "sonar"]
    assert all(line.count("ATE ") == 1 for line in runs) and sum("of the bound" in line for line in runs) >= 2
    for title in ("navigation, ATE / bound, mean of 1", "navigation, NEES per degree of freedom, position, mean of 1"):
        assert sum(line.startswith(title) for line in table) == 1, title
    assert any(line.startswith("narrow sonar alone, ATE / path, worst: seafloor-didson-transect-4x") for line in table)
    written = [path.stat().st_mtime_ns for path in sorted(tmp_path.glob("*/sequence.yaml"))]
    assert main([*command, "--modes", "odometry", "--jobs", "2", "--no-bound"]) == 1
    alone = capsys.readouterr().out.splitlines()[0]
    assert alone.split("; ")[:2] == runs[1].split("; ")[:2], "the same in a process of its own"
    assert [path.stat().st_mtime_ns for path in sorted(tmp_path.glob("*/sequence.yaml"))] == written, "simulated once"
    assert main(["backend", "--scenes", "nowhere", *few]) == 1
    assert "nowhere" in capsys.readouterr().err
