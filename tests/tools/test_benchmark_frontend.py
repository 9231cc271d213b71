"""The front-end's table: that its numbers are what they say, on a small tank."""

import importlib
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from asfm.commands import SimulationOptions, simulate_to
from asfm.config import Config
from asfm.datasets import open_sequence, open_truth
from asfm.types import Matches


@pytest.fixture
def tools(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the tools find each other, as when one is run as a script."""


@pytest.fixture(scope="module")
def tank(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "tank"
    simulate_to("tank", folder, SimulationOptions(sonar="holoocean", frames=4))
    return folder


def load(name: str) -> ModuleType:
    return importlib.import_module(name)


def test_a_number_knows_whether_it_is_reached(tools: None) -> None:
    make = load("tools.benchmark.frontend").Requirement
    assert make("a", 1.5, at_most=1.5).ok and not make("a", 1.6, at_most=1.5).ok
    assert make("a", 0.97, at_least=0.97).ok and not make("a", 0.96, at_least=0.97).ok
    assert make("a", None, at_most=1.0).ok is False, "what was not measured is not reached"
    assert make("a", 3.0).ok is None
    lines = load("tools.benchmark.frontend").tabulate([make("a", 1.5, "ms", at_most=1.5), make("b", None, at_least=2)])
    assert [line.split() for line in lines[1:]] == [["a", "≤", "1.5", "1.5", "ms", "yes"], ["b", "≥", "2", "-", "NO"]]


def test_the_clock_runs_while_the_front_end_works(tools: None, tank: Path) -> None:
    """By a clock that ticks once a look, a frame and A-KAZE alone take one tick each."""
    ticks = iter(range(1000))
    passage = load("tools.benchmark.frontend_pass").run_frontend(
        open_sequence(tank), Config(), lambda: float(next(ticks))
    )
    assert (passage.frame_s, passage.akaze_s) == (1.0, 1.0)
    assert [len(passage.pairs(gap)) for gap in (1, 2, 3, 4)] == [3, 2, 1, 0]
    assert len(passage.keypoints) == 4 and min(map(len, passage.keypoints)) > 5


def test_matches_are_judged_by_the_truth(tools: None, tank: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module, sequence, config = load("tools.benchmark.frontend_pass"), open_sequence(tank), Config()
    read_truth = open_truth(tank)
    assert read_truth is not None
    passage = module.run_frontend(sequence, config, lambda: 0.0)
    judged = module.judge_by_truth(passage, sequence, read_truth, 1, config)
    assert 0 < judged.right <= judged.matches == sum(map(len, passage.pairs(1)))
    assert judged.precision > 0.5 and judged.kept == judged.right / judged.ratio_test_right
    assert judged.error.shape == (judged.right, 2)

    unit = np.array([sequence.sonar.range_step_m, sequence.sonar.bearing_step_rad])
    see = module.seen_places
    with monkeypatch.context() as patch:
        patch.setattr(module, "seen_places", lambda b, matches: see(b, matches) + [2.0, -1.0] * unit)
        shifted = module.judge_by_truth(passage, sequence, read_truth, 1, config)
    np.testing.assert_allclose(shifted.error - judged.error, np.tile([2.0, -1.0], (judged.right, 1)), atol=1e-6)

    share, of_ratio_test = module.judge_by_arcs(passage, sequence, 1, config)
    assert 0.5 < share <= 1 and 0 < of_ratio_test <= 1
    crossed = [
        Matches(m.frame_a, m.frame_b, np.stack([m.index[:, 0], np.roll(m.index[:, 1], 1)], axis=1), m.cost)
        for m in passage.candidates
    ]
    wrong, _ = module.judge_by_arcs(replace(passage, candidates=crossed), sequence, 1, config)
    assert wrong < 0.5 * share, "partners exchanged do not fit"


def test_nothing_matched_is_nothing_reached(tools: None, tank: Path) -> None:
    module, sequence = load("tools.benchmark.frontend_pass"), open_sequence(tank)
    passage = module.FrontendPass([], [], 1.0, 1.0)
    assert module.judge_by_arcs(passage, sequence, 1, Config()) == (None, None)
    judged = module.judge_by_truth(passage, sequence, open_truth(tank), 1, Config())
    assert (judged.precision, judged.kept, judged.spread(0)) == (None, None, (None, None))


def test_the_table_is_printed(
    tools: None, tank: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    benchmark = load("tools.benchmark.__main__")
    monkeypatch.setattr(load("tools.benchmark.frontend"), "SHAPE", (80, 60))
    command = ["frontend", str(tank.parent), "--sequences", "tank", "--rounds", "1", "--set", "matching.max_gap=2"]
    assert benchmark.main(command) == 1, "over a gap of 8 nothing is matched, so not every number is reached"
    lines = capsys.readouterr().out.splitlines()
    for title in ("CFAR CA ", "CFAR OS ", "DBSCAN, ", "SSL, largest difference", "tank, front-end over A-KAZE"):
        assert sum(line.startswith(title) for line in lines) == 1, title
    assert benchmark.main(["frontend", str(tank.parent), "--sequences", "gone", "--rounds", "1"]) == 1
    assert "gone: expected a sequence" in capsys.readouterr().err
