"""``asfm simulate``: sequences, motions, formats and diagnostics."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from asfm.cli import run_command_line
from asfm.commands import SimulationOptions, simulate_to
from asfm.datasets import open_sequence, open_truth
from asfm.datasets.tables import read_tum
from asfm.simulation.scenes.catalogue import SCENES
from asfm.simulation.sonars.presets import PRESETS

Ask = Callable[..., str]

FRAMES = 6


def test_simulate_writes_a_sequence_with_truth(tmp_path: Path, ask: Ask, capsys: Any) -> None:
    text = ask("simulate", "tank", "--output", tmp_path / "a", "--frames", "2", "--sonar", "aris_3000")
    assert f"asfm run {tmp_path / 'a'} --output" in text
    sequence, read_truth = open_sequence(tmp_path / "a"), open_truth(tmp_path / "a")
    assert len(sequence) == 2 and sequence.sonar.shape[1] == 128 and sequence.groundtruth is not None
    assert read_truth is not None and np.isfinite(read_truth(1).elevation_rad).any()
    simulate_to("tank", tmp_path / "b", SimulationOptions(sonar="aris_3000", frames=2))
    for path in sorted(path for path in (tmp_path / "a").rglob("*") if path.is_file()):
        assert path.read_bytes() == (tmp_path / "b" / path.relative_to(tmp_path / "a")).read_bytes(), path.name
    assert run_command_line(["simulate", "tank", "--output", str(tmp_path / "a"), "--frames", "1"]) == 2
    assert "already holds a sequence" in capsys.readouterr().err
    ask("simulate", "tank", "--output", tmp_path / "a", "--frames", "1", "--overwrite")
    assert len(open_sequence(tmp_path / "a")) == 1


def test_simulate_takes_its_scene_as_argument_or_option(tmp_path: Path, ask: Ask, capsys: Any) -> None:
    text = ask("simulate", "--scene", "tank", "--output", tmp_path / "a", "--frames", "1")
    assert text.startswith("1 frame in")
    for both in (["tank", "--scene", "pier"], []):
        assert run_command_line(["simulate", *both, "--output", str(tmp_path / "b")]) == 2
        assert "expected one scene" in capsys.readouterr().err


def test_simulate_follows_a_motion_or_a_path(demo_folder: Path, tmp_path: Path, ask: Ask, capsys: Any) -> None:
    still, along = tmp_path / "still", tmp_path / "along"
    ask("simulate", "tank", "--output", still, "--frames", "2", "--motion", "static")
    truth = open_sequence(still).groundtruth
    assert truth is not None and np.array_equal(truth.world_from_vehicle[0], truth.world_from_vehicle[1])
    path = demo_folder / "seafloor" / "groundtruth.tum"
    text = ask("simulate", "tank", "--output", along, "--motion", path, "--sonar", "didson")
    truth, expected = open_sequence(along).groundtruth, read_tum(path)
    assert truth is not None and text.startswith(f"{len(truth.timestamps_s)} frames in ")
    assert FRAMES - 1 <= len(truth.timestamps_s) <= FRAMES, "the path ends before 80 frames"
    np.testing.assert_allclose(truth.world_from_vehicle[:2], expected.world_from_vehicle[:2], atol=1e-5)
    for motion, fault in (("flight", "unknown motion 'flight'; known: "), ("gone.tum", "gone.tum")):
        arguments = ["simulate", "seafloor", "--output", str(tmp_path / "out"), "--motion", motion]
        assert run_command_line(arguments) == 2
        message = capsys.readouterr().err
        assert fault in message and message.count("\n") == 1


def test_simulate_prints_diagnostics(tmp_path: Path, capsys: Any) -> None:
    away = tmp_path / "away.tum"
    away.write_text("0 0 0 2 0 -0.5 0 0.8660254\n1 0 0 2 0 -0.5 0 0.8660254\n")  # looks up
    arguments = ["simulate", "tank", "--output", str(tmp_path / "out"), "--frames", "2", "--motion", str(away)]
    assert run_command_line(arguments) == 0
    assert "warning: 2 of 2 frames see nothing of tank within " in capsys.readouterr().err


def test_simulate_writes_the_holoocean_format(tmp_path: Path, ask: Ask, capsys: Any) -> None:
    common = ("simulate", "tank", "--frames", "2", "--sonar", "holoocean")
    ask(*common, "--output", tmp_path / "pickles", "--format", "holoocean")
    ask(*common, "--output", tmp_path / "native")
    pickles, native = open_sequence(tmp_path / "pickles"), open_sequence(tmp_path / "native")
    assert (pickles.kind, native.kind) == ("holoocean", "native")
    for one, other in zip(pickles, native, strict=True):
        np.testing.assert_allclose(one.image, other.image, atol=0.5 / 255 + 1e-6)
    assert run_command_line([*common, "--output", str(tmp_path / "out"), "--format", "rosbag"]) == 2
    message = capsys.readouterr().err
    assert "known: native, holoocean" in message and message.count("\n") == 1


def test_unknown_name_errors_list_the_known_names(tmp_path: Path, capsys: Any) -> None:
    assert run_command_line(["simulate", "moon", "--output", str(tmp_path / "out")]) == 2
    message = capsys.readouterr().err
    assert all(name in message for name in SCENES) and message.count("\n") == 1
    assert run_command_line(["simulate", "pier", "--output", str(tmp_path / "out"), "--sonar", "ear"]) == 2
    message = capsys.readouterr().err
    assert all(name in message for name in PRESETS) and message.count("\n") == 1
    for option in ("--frames", "--seed"):
        assert run_command_line(["simulate", "pier", "--output", str(tmp_path / "out"), option, "-1"]) == 2
        assert "-1" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
