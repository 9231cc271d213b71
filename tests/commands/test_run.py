"""``asfm run``: results, settings, and recordings with little overlap."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from asfm import __version__
from asfm.cli import run_command_line
from asfm.config import Config
from asfm.config_file import load_config

Ask = Callable[..., str]

FRAMES = 6


def test_run_writes_all_results(demo_folder: Path) -> None:
    results = demo_folder / "results"
    names = {"trajectory.tum", "points.ply", "pose_sigmas.csv", "tracks.csv", "reconstruction.rrd"}
    names |= {"report.json", "config.yaml", "evaluation.json"}
    names |= {"pose_covariances.csv", "features.h5", "matches.h5"}
    assert {path.name for path in results.iterdir()} == names
    assert load_config(results / "config.yaml") == Config()
    report = json.loads((results / "report.json").read_text())
    assert report["sequence"] == {
        "path": str(demo_folder / "seafloor"),
        "name": "seafloor",
        "format": "native",
        "frames": FRAMES,
    }
    assert report["seed"] == 0 and report["counts"]["poses"] == FRAMES and report["counts"]["landmarks"] > 0
    assert report["versions"]["asfm"] == __version__ and report["versions"]["numpy"] == np.__version__
    assert all(report["versions"].values())
    assert 0 < sum(stage["wall_s"] for stage in report["stages"]) <= report["wall_s"]
    assert all(50 < stage["peak_memory_mb"] < 5000 for stage in report["stages"])
    assert report["noise"]["estimated"] is False and 0.5 < report["noise"]["range_bins"] != Config().noise.range_bins
    counts = {stage["name"]: stage["counts"] for stage in report["stages"]}
    assert counts["front-end"]["frames"] == FRAMES and 0.001 < counts["noise"]["range noise m"] < 0.05


def test_settings_are_read_from_file_and_command_line(demo_folder: Path, tmp_path: Path, ask: Ask) -> None:
    (tmp_path / "mine.yaml").write_text("backend: {rounds: 2}\nseed: 3\n")
    command: list[str | Path] = [
        "run",
        demo_folder / "seafloor",
        "--output",
        tmp_path / "out",
        "--config",
        tmp_path / "mine.yaml",
    ]
    text = ask(*command, "--set", "seed=4", "--set", "cfar.guard_px=[3, 3]", "--mode", "batch", "--no-rerun")
    assert "reconstruction.rrd" not in {path.name for path in (tmp_path / "out").iterdir()}
    assert "asfm view" not in text, "there is no recording"
    resolved = load_config(tmp_path / "out" / "config.yaml")
    assert (resolved.backend.rounds, resolved.seed, resolved.cfar.guard_px) == (2, 4, (3, 3))
    assert json.loads((tmp_path / "out" / "report.json").read_text())["seed"] == 4


@pytest.mark.parametrize(
    ("name", "frames", "warns"),
    [("aris/sample.aris", 6, True), ("turtle_sim", 60, False), ("holoocean_boat", 60, True)],
)
def test_recordings_with_little_overlap_run_to_the_end(
    shared_data: Path, tmp_path: Path, name: str, frames: int, warns: bool, capsys: Any
) -> None:
    assert run_command_line(["run", str(shared_data / name), "--output", str(tmp_path / "out"), "--no-rerun"]) == 0
    rows = np.loadtxt(tmp_path / "out" / "trajectory.tum")
    assert rows.shape == (frames, 8) and np.isfinite(rows).all()
    if warns:
        assert "warning: " in capsys.readouterr().err


@pytest.mark.parametrize("alone", [True, False])
def test_the_error_of_the_mirror_image_is_given_where_the_run_does_not_tell_it_apart(
    tmp_path: Path, ask: Ask, alone: bool
) -> None:
    ask("simulate", "tank", "--frames", "6", "--output", tmp_path / "tank")
    switch = "false" if alone else "true"
    settings = [f"backend.use_odometry={switch}", f"backend.use_navigation={switch}"]
    results = tmp_path / "results"
    options = [part for setting in settings for part in ("--set", setting)]
    ask("run", tmp_path / "tank", "--output", results, "--no-rerun", *options)
    codes = {warning["code"] for warning in json.loads((results / "report.json").read_text())["warnings"]}
    written = {row["key"]: row["value"] for row in json.loads((results / "evaluation.json").read_text())["rows"]}
    assert ("mirror-ambiguity" in codes) == ("ate_rmse_m_se3_mirror_image" in written) == alone
    ask("evaluate", results)
    again = {row["key"]: row["value"] for row in json.loads((results / "evaluation.json").read_text())["rows"]}
    assert again.get("ate_rmse_m_se3_mirror_image") == written.get("ate_rmse_m_se3_mirror_image")


def test_a_part_of_a_recording_is_run_and_evaluated_as_that_part(demo_folder: Path, tmp_path: Path, ask: Ask) -> None:
    """Every second frame from the second on; with the whole run's matches it has those between its frames."""
    whole, part, given = demo_folder / "results", tmp_path / "part", tmp_path / "given"
    options = ("--no-rerun", "--set", "frames.first=1", "--set", "frames.every=2")
    ask("run", demo_folder / "seafloor", "--output", part, *options)
    stamps_s = [np.loadtxt(results / "trajectory.tum")[:, 0] for results in (whole, part)]
    np.testing.assert_array_equal(stamps_s[1], stamps_s[0][1::2])
    ask("evaluate", part)
    found = {row["key"]: row["value"] for row in json.loads((part / "evaluation.json").read_text())["rows"]}
    assert found["poses_compared"] == FRAMES // 2 and found["match_precision_gap_1"] > 0.7
    assert found["ate_over_bound"] > 0
    hloc = ("--features", whole / "features.h5", "--matches", whole / "matches.h5")
    ask("run", demo_folder / "seafloor", "--output", given, *options, *hloc)
    with h5py.File(given / "matches.h5") as file:
        assert sorted(file) == ["frames-000001.png", "frames-000003.png"]
        assert list(file["frames-000001.png"]) == ["frames-000003.png", "frames-000005.png"]
    own = ("--features", part / "features.h5", "--matches", part / "matches.h5")
    ask("run", demo_folder / "seafloor", "--output", tmp_path / "again", *options, *own)
    with h5py.File(part / "matches.h5") as first, h5py.File(tmp_path / "again" / "matches.h5") as second:
        assert sorted(first) == sorted(second)


def test_damage_outside_a_part_does_not_matter(demo_folder: Path, tmp_path: Path, ask: Ask) -> None:
    shutil.copytree(demo_folder / "seafloor", tmp_path / "seafloor")
    (tmp_path / "seafloor" / "frames" / f"{FRAMES - 1:06d}.png").write_bytes(b"damaged")
    arguments = ["run", str(tmp_path / "seafloor"), "--output", str(tmp_path / "r"), "--no-rerun"]
    assert run_command_line(arguments) == 2
    ask(*arguments, "--set", f"frames.last={FRAMES - 2}")


def test_a_part_beyond_the_recording_is_one_line(demo_folder: Path, tmp_path: Path, capsys: Any) -> None:
    arguments = [
        "run",
        str(demo_folder / "seafloor"),
        "--output",
        str(tmp_path / "r"),
        "--set",
        f"frames.first={FRAMES}",
    ]
    assert run_command_line(arguments) == 2
    assert "expected a frame of seafloor, which has 0 to 5, found 6" in capsys.readouterr().err
    assert not (tmp_path / "r").exists()
