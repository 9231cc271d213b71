"""The tools: that they parse what they say, and that one tiny benchmark of each kind works."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

import pytest

from asfm.commands import SimulationOptions, simulate_to

TOOLS = Path(__file__).resolve().parents[2] / "tools"


@pytest.fixture
def benchmark(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The benchmark as Python finds it when it is run as a script."""
    return importlib.import_module("tools.benchmark.__main__")


def test_every_tool_explains_itself(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    for path in sorted(TOOLS.rglob("*.py")):
        name = ".".join(path.relative_to(TOOLS.parent).with_suffix("").parts)
        module = importlib.import_module(name)
        if not hasattr(module, "main"):
            continue
        monkeypatch.setattr(sys, "argv", [path.name, "--help"])
        with pytest.raises(SystemExit) as left:
            module.main()
        assert left.value.code == 0
        assert f"python -m {name.removesuffix('.__main__')} " in capsys.readouterr().out


def test_the_benchmark_parses_its_commands(benchmark: ModuleType) -> None:
    parse = benchmark.make_parser().parse_args
    run = parse(["run", "sequence", "--set", "seed=1", "--set", "backend.rounds=1"])
    assert (run.sequence, run.settings, run.recording) == (Path("sequence"), ["seed=1", "backend.rounds=1"], False)
    assert parse(["run", "sequence"]).settings == []
    assert parse(["public", "data", "--recording"]).recording
    assert parse(["all", "--shape", "30", "20"]).shape == [30, 20]
    for wrong in ([], ["run"], ["public"], ["sift"]):
        with pytest.raises(SystemExit):
            parse(wrong)


def test_stages_agree_with_their_peers(benchmark: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert benchmark.main(["all", "--shape", "120", "60", "--rounds", "1"]) == 0
    assert capsys.readouterr().out.count("asfm  ") == len(benchmark.COMPARISONS)
    original = benchmark.COMPARISONS["clusters"]((60, 40), 0)
    wrong = benchmark.Comparison("wrong", original.ours, {"peer": lambda: ~original.ours()}, original.tolerance)
    assert not benchmark.report(wrong, 1), "a benchmark of other results would be seen"


def test_a_run_is_measured_in_a_child(
    benchmark: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    simulate_to("tank", tmp_path / "tank", SimulationOptions(sonar="holoocean", frames=3))
    assert benchmark.main(["run", str(tmp_path / "tank"), "--set", "backend.rounds=1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    shown = {line.split("  ")[0]: line.split() for line in lines}
    assert shown["frames"][-1] == "3"
    ate_m, odometry_m = (float(shown[name][-2]) for name in ("ATE, SE(3)-aligned, no scale", "the odometry's ATE"))
    assert float(shown["ratio"][-1]) == pytest.approx(ate_m / odometry_m, rel=0.1)
    assert float(shown["wall"][-2]) > 0 and 50 < float(shown["peak"][-2]) < 5000
    assert any(line.startswith("stage ") for line in lines)

    runs = importlib.import_module("tools.benchmark.runs")
    monkeypatch.setattr(runs, "REACH", (("gone", "gone", ()),))
    assert benchmark.main(["public", str(tmp_path)]) == 1
    assert "failed" in capsys.readouterr().out
    assert benchmark.main(["run", str(tmp_path / "gone")]) == 1
    assert "gone: expected a sequence" in capsys.readouterr().err


def test_what_is_not_known_is_a_dash(benchmark: ModuleType) -> None:
    runs = importlib.import_module("tools.benchmark.runs")
    report = {
        "sequence": {"frames": 6},
        "stages": [],
        "warnings": [{"code": "empty-frames", "message": "little is seen"}],
    }
    unknown = runs.summarise(report, [], 2.0)
    assert runs._cells(unknown) == ("6", "-", "-", "2.0", "0", "1")
    assert runs.describe_run(unknown)[-1] == "warning: little is seen [empty-frames]"
    rows = [{"name": runs.ATE, "value": 0.02}, {"name": runs.PATH_SHARE, "value": 1.5}]
    assert runs._cells(runs.summarise(report, rows, 2.0))[1:3] == ("0.0200", "1.50 %")
    rows[0] |= {"odometry": 0.04, "ratio": 0.5}
    assert runs._cells(runs.summarise(report, rows, 2.0))[1:3] == ("0.0200", "0.500 x")


def test_a_defect_is_named_by_its_exception(benchmark: ModuleType) -> None:
    explain = importlib.import_module("tools.benchmark.runs")._explain_failure
    trace = "stage: 3 steps\nTraceback (most recent call last):\n  File x\n    call()\n"
    trace += "RuntimeError: \nSingular\nasfm: a defect\n"
    assert explain(1, trace) == "RuntimeError: Singular asfm: a defect"
    assert explain(2, "stage: 3 steps\nasfm: no such file\n") == "asfm: no such file"
    assert explain(-9, "") == "ended with code -9"


def test_false_alarm_rates_are_listed(benchmark: ModuleType) -> None:
    rates = importlib.import_module("tools.benchmark.false_alarm_rates")
    speckle = rates._make_noise("rayleigh", 0)
    line = next(iter(list(rates._rate("noise", [speckle], slice(None), ("rayleigh",), ("ca",)))[1:]))
    assert [float(ratio) for ratio in line.split()[-3:-1]] == pytest.approx([1.0, 1.0], rel=0.1)
    assert benchmark.make_parser().parse_args(["rates"]).data is None
