"""Requirements on the front-end and its timed pass, on a small tank."""

from pathlib import Path

import numpy as np
import pytest

from asfm.commands import SimulationOptions, simulate_to
from asfm.config import Config
from asfm.datasets import open_sequence
from asfm.evaluation.matching import MatchQuality
from tools.benchmark import frontend
from tools.benchmark.__main__ import main
from tools.benchmark.frontend_pass import match_by_descriptors, run_frontend


@pytest.fixture(scope="module")
def tank(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "tank"
    simulate_to("tank", folder, SimulationOptions(sonar="holoocean", frames=4))
    return folder


def test_times_are_those_of_the_front_end(tank: Path) -> None:
    """With a clock that ticks at each call, a frame and A-KAZE alone take one tick each."""
    ticks = iter(range(1000))
    found = run_frontend(open_sequence(tank), Config(), lambda: float(next(ticks)))
    assert (found.frame_s, found.akaze_s) == (1.0, 1.0)
    assert [len(found.pairs(gap)) for gap in (1, 2, 3, 4)] == [3, 2, 1, 0]
    assert len(found.keypoints) == 4 and min(map(len, found.keypoints)) > 5


def test_descriptors_alone_match_more_than_all_filters_keep(tank: Path) -> None:
    config = Config()
    found = run_frontend(open_sequence(tank), config, lambda: 0.0)
    unfiltered = match_by_descriptors(found.keypoints, found.pairs(1), config.matching)
    assert [(pair.frame_a, pair.frame_b) for pair in unfiltered] == [(0, 1), (1, 2), (2, 3)]
    for filtered, pair in zip(found.pairs(1), unfiltered, strict=True):
        assert {tuple(row) for row in filtered.index.tolist()} < {tuple(row) for row in pair.index.tolist()}


def test_localisation_error_is_in_pixels(tank: Path) -> None:
    sequence = open_sequence(tank)
    units = sequence.sonar.range_step_m, sequence.sonar.bearing_step_rad
    quality = MatchQuality(2, 2, 2, np.array([1.0, 3.0]) * units[0], np.array([-1.0, -1.0]) * units[1])
    rows = list(frontend._list_localisation("here", quality, sequence))
    assert [row.reached for row in rows] == pytest.approx([1, 2, 0, 1])
    assert [row.unit for row in rows] == ["range bins", "range bins", "beams", "beams"]
    assert {row.reached for row in frontend._list_localisation("here", frontend.NO_PAIRS, sequence)} == {None}


def test_the_table_is_printed(tank: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(frontend, "SHAPE", (80, 60))
    command = ["frontend", str(tank.parent), "--sequences", "tank", "--rounds", "1", "--set", "matching.max_gap=2"]
    assert main(command) == 1, "nothing is matched over a gap of 8, so not every requirement is met"
    lines = capsys.readouterr().out.splitlines()
    for title in ("CFAR CA ", "CFAR OS ", "DBSCAN, ", "SSL, largest difference", "tank, front-end over A-KAZE"):
        assert sum(line.startswith(title) for line in lines) == 1, title
    assert main(["frontend", str(tank.parent), "--sequences", "gone", "--rounds", "1"]) == 1
    assert "gone: expected a sequence" in capsys.readouterr().err


def test_match_quality_is_listed_by_truth_or_by_arcs(
    tank: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(frontend, "_measure_stages", lambda rounds, clock: iter(()))
    main(["frontend", str(tank.parent), "--sequences", "tank"])
    by_truth = [line.split("  ")[0] for line in capsys.readouterr().out.splitlines()]
    assert "tank, gap 1, precision" in by_truth and "tank, gap 8, recall" in by_truth
    monkeypatch.setattr(frontend, "open_truth", lambda path: None)
    main(["frontend", str(tank.parent), "--sequences", "tank"])
    by_arcs = {line.split("  ")[0]: line.split()[-2] for line in capsys.readouterr().out.splitlines()[1:]}
    assert 0.5 < float(by_arcs["tank, gap 1, arc inlier ratio"]) <= 1
    assert by_arcs["tank, gap 8, arc inlier ratio"] == "-"
