"""Sequences of a study: simulated ones are written once, recordings opened in their place, both as far as chosen."""

from dataclasses import replace
from pathlib import Path

import pytest

from asfm.config import Config
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError
from asfm.simulation.simulate import simulate
from asfm.study.cell import Cell, Recording, Simulation
from asfm.study.feature_cache import StudyCache
from asfm.study.sequence_provider import check_sensors, provide_sequence

FRAMES = Config.model_validate({"frames": {"first": 1, "every": 2}})
CELL = Cell(Simulation("tank", "didson", None, 5, 4), 2, "all", "akaze", "default", "default", FRAMES, 3)


def test_a_simulated_sequence_is_written_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = StudyCache(tmp_path)
    opened = provide_sequence(CELL, cache)
    assert len(opened.whole) == 4 and len(opened.sequence) == 2 and opened.chosen.tolist() == [1, 3]
    assert opened.sequence.name == "tank-didson-scene5" and opened.read_truth is not None
    expected = simulate("tank", "didson", 4, 2, scene_seed=5)
    assert opened.sequence.odometry and expected.sequence.odometry
    assert opened.sequence.odometry.world_from_vehicle == pytest.approx(
        expected.sequence.odometry.world_from_vehicle, abs=1e-8
    )
    assert opened.sequence.read_frame(1).image == pytest.approx(expected.sequence.read_frame(3).image, abs=0.01)
    assert opened.read_truth(1).clean == pytest.approx(expected.read_truth(3).clean, abs=0.01)
    monkeypatch.setattr("asfm.simulation.simulate.simulate", None)
    assert provide_sequence(replace(CELL, mode="sonar"), cache).path == opened.path


def test_a_recording_is_opened_where_it_is(tmp_path: Path) -> None:
    write_native(tmp_path / "mine", simulate("tank", "didson", 4).sequence)
    cell = replace(CELL, sequence=Recording("mine", tmp_path / "mine", "content"))
    opened = provide_sequence(cell, StudyCache(tmp_path / "cache"))
    assert opened.path == tmp_path / "mine" and opened.read_truth is None and len(opened.sequence) == 2
    assert not (tmp_path / "cache").exists()


def test_modes_without_their_sensors_are_refused() -> None:
    full = simulate("tank", "didson", 3).sequence
    bare = replace(full, odometry=None)
    check_sensors(bare, "all")
    check_sensors(bare, "sonar")
    with pytest.raises(AsfmError, match="mode odometry needs odometry, found none"):
        check_sensors(bare, "odometry")
    with pytest.raises(AsfmError, match="mode all needs odometry, or depth and attitude"):
        check_sensors(replace(bare, navigation=None), "all")
    check_sensors(full, "odometry")
