"""``asfm denoise``: tables over simulated frames and over sequences with truth, their files, and errors."""

import csv
import json
from pathlib import Path
from shutil import rmtree
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh

from asfm.cli import run_command_line
from asfm.commands import DenoiseSources, SimulationOptions, denoise_sources, simulate_to
from asfm.errors import AsfmError
from asfm.evaluation.denoising.methods import DENOISERS, MASK, OURS, RAW, WAVELET

PLAIN = {
    "RangeMax": 6.0,
    "RangeBins": 200,
    "AzimuthBins": 64,
    "ElevationBins": 160,
    "AddSigma": 0.04,
    "MultSigma": 0.17,
}


@pytest.fixture(scope="module")
def sonar(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_sonar(tmp_path_factory.mktemp("sonar") / "small.json")


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return a box as a mesh file, which renders faster than the named scenes."""
    path = tmp_path_factory.mktemp("scene") / "box.obj"
    trimesh.creation.box((1.0, 2.0, 0.6)).export(path)
    return str(path)


def write_sonar(path: Path, **settings: Any) -> str:
    sensor = {"sensor_type": "ImagingSonar", "configuration": {**PLAIN, **settings}}
    path.write_text(json.dumps({"name": "test", "agents": [{"sensors": [sensor]}]}), encoding="utf-8")
    return str(path)


def ask(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    capsys.readouterr()
    assert run_command_line(["denoise", *map(str, arguments)]) == 0, capsys.readouterr().err
    return capsys.readouterr().out


def refuse(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """Run a command line that must fail with one line; returns the line."""
    capsys.readouterr()
    assert run_command_line(["denoise", *map(str, arguments)]) == 2
    output = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("denoise: ")]
    assert len(output) == 1 and output[0].startswith("asfm: ")
    return output[0]


def test_psnr_margins_of_the_paper_are_reached() -> None:
    """5.57 dB over raw and 1.90 dB over the wavelet on seeds not used for tuning; the support gains too."""
    table = denoise_sources(DenoiseSources(scenes=["pier", "tank"], sonars=["aris_3000"], seed=900))
    raw, wavelet, ours = (table.average(method) for method in (RAW, WAVELET, OURS))
    assert ours.psnr_db > raw.psnr_db + 5.57 and ours.psnr_db > wavelet.psnr_db + 1.90
    assert ours.support_psnr_db is not None and raw.support_psnr_db is not None
    assert ours.support_psnr_db > raw.support_psnr_db + 3 and ours.ssim > 0.6
    assert table.average(MASK).support_psnr_db < raw.support_psnr_db, "the listed losses would be wrong"  # type: ignore[operator]


def test_image_without_noise_loses_little(tmp_path: Path) -> None:
    quiet = write_sonar(tmp_path / "quiet.json", AddSigma=0.0, MultSigma=0.0)
    table = denoise_sources(DenoiseSources(scenes=["hull"], sonars=[quiet]))
    assert table.average(OURS).psnr_db > table.average(RAW).psnr_db - 1


def test_simulated_frames_give_a_table_and_its_files(tmp_path: Path, capsys: Any, sonar: str) -> None:
    folder = tmp_path / "table"
    options = ("--scene", "pier", "--scene", "tank", "--sonar", sonar, "--output", folder)
    output = ask(capsys, *options)
    assert "mean over 2 frames" in output and "PSNR dB by scene" in output and f"{MASK} loses in PSNR" in output
    for method in DENOISERS:
        assert f"\n{method} " in output
    with (folder / "denoising.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * len(DENOISERS) and {row["scene"] for row in rows} == {"pier", "tank"}
    report = json.loads((folder / "denoising.json").read_text(encoding="utf-8"))
    mean = np.mean([float(row["psnr_db"]) for row in rows if row["method"] == OURS])
    assert report["mean"][OURS]["psnr_db"] == pytest.approx(mean, abs=1e-3)
    picture = cv2.imread(str(folder / "denoising.png"), cv2.IMREAD_GRAYSCALE)
    assert picture is not None and picture.shape[1] % (len(DENOISERS) + 1) == 0 and picture.std() > 10
    assert "already holds a denoising table" in refuse(capsys, *options)
    ask(capsys, "--scene", "pier", "--sonar", sonar, "--output", folder, "--overwrite")
    assert json.loads((folder / "denoising.json").read_text(encoding="utf-8"))["by_scene"].keys() == {"pier"}


def test_sequences_with_truth_are_compared(tmp_path: Path, capsys: Any, sonar: str, scene: str) -> None:
    simulate_to(scene, tmp_path / "scene", SimulationOptions(sonar, frames=3, seed=1))
    output = ask(capsys, tmp_path / "scene", "--frames", 2)
    assert "mean over 2 frames" in output and "by scene" not in output
    table = denoise_sources(DenoiseSources([tmp_path / "scene"], frames=99))
    assert [row.frame for row in table.rows[:: len(DENOISERS)]] == [0, 1, 2]


def test_seed_that_cannot_be_simulated_is_skipped(sonar: str, scene: str, capsys: Any, monkeypatch: Any) -> None:
    from asfm.simulation import simulate as module

    simulate = module.simulate

    def fail_at_seed_5(name: str, sonar: str, frames: int, seed: int) -> module.SimulatedSequence:
        if seed == 5:
            raise AsfmError("the sonar is inside an object")
        return simulate(name, sonar, frames, seed)

    monkeypatch.setattr(module, "simulate", fail_at_seed_5)
    output = ask(capsys, "--scene", scene, "--sonar", sonar, "--seed", 5, "--frames", 2)
    assert "mean over 1 frame\n" in output and "of seed 5: the sonar is inside an object" in output
    assert "inside an object" in refuse(capsys, "--scene", scene, "--sonar", sonar, "--seed", 5)


def test_settings_change_the_mask(sonar: str, scene: str, capsys: Any) -> None:
    plain, wide = (
        ask(capsys, "--scene", scene, "--sonar", sonar, "--set", f"keypoints.margin_px={margin}") for margin in (0, 9)
    )
    assert find_psnr(wide, MASK) != find_psnr(plain, MASK) and find_psnr(wide, WAVELET) == find_psnr(plain, WAVELET)


def find_psnr(output: str, method: str) -> str:
    line = next(line for line in output.splitlines() if line.startswith(f"{method} "))
    return line.removeprefix(method).split()[0]


def test_unusable_input_is_a_one_line_error(tmp_path: Path, capsys: Any, sonar: str, scene: str) -> None:
    assert "unknown scene 'moon'" in refuse(capsys, "--scene", "moon")
    assert "unknown sonar preset 'ear'" in refuse(capsys, "--sonar", "ear")
    assert "at least one frame" in refuse(capsys, "--frames", 0)
    assert "seed of zero or more" in refuse(capsys, "--seed", -1)
    assert "found both" in refuse(capsys, tmp_path, "--scene", "pier")
    assert str(tmp_path / "nothing") in refuse(capsys, tmp_path / "nothing")
    simulate_to(scene, tmp_path / "scene", SimulationOptions(sonar, frames=1))
    rmtree(tmp_path / "scene" / "truth")
    assert "found no truth folder" in refuse(capsys, tmp_path / "scene")
    small = write_sonar(tmp_path / "small.json", RangeBins=60, AzimuthBins=8)
    output = tmp_path / "out"
    assert "at least 11 x 11 pixels" in refuse(capsys, "--scene", scene, "--sonar", small, "--output", output)
    assert not output.exists(), "an incomplete folder was left"
