"""A HoloOcean scenario describes the sonar, and a simulated sequence can be written as HoloOcean would."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asfm.datasets import open_sequence
from asfm.errors import AsfmError
from asfm.poses import invert
from asfm.simulation.pickles import describe_scenario, write_pickles
from asfm.simulation.presets import PRESETS
from asfm.simulation.scenario import read_scenario
from asfm.simulation.sensor import ImagingSonar
from asfm.simulation.simulate import simulate


def _write(path: Path, sensor: dict[str, Any] | None = None, **configuration: Any) -> Path:
    sonar = {"sensor_type": "ImagingSonar", "configuration": configuration, **(sensor or {})}
    scenario = {"name": "test", "agents": [{"sensors": [{"sensor_type": "PoseSensor"}, sonar]}]}
    path.write_text(json.dumps(scenario), encoding="utf-8")
    return path


def test_scenario_of_the_public_recording_is_read(shared_data: Path) -> None:
    scenario = read_scenario(shared_data / "holoocean_boat" / "Config.json")
    sonar = scenario.sonar
    assert (sonar.range_bins, sonar.azimuth_bins, sonar.range_max) == (512, 96, 8.0)
    assert (sonar.azimuth, sonar.elevation, sonar.add_sigma, sonar.mult_sigma) == (28.8, 14.0, 0.15, 0.2)
    assert sonar.multi_path and sonar.rate_hz == 1
    forward = scenario.vehicle_from_sonar[:3, 0]
    assert forward == pytest.approx([np.sqrt(0.5), 0, -np.sqrt(0.5)])  # pitched down by 45 deg about the left axis


def test_resolutions_and_covariances_become_bins_and_sigmas(tmp_path: Path) -> None:
    path = _write(tmp_path / "a.json", RangeMin=1, RangeMax=5, RangeRes=0.01, Azimuth=60, AzimuthRes=0.5, AddCov=0.04)
    sonar = read_scenario(path).sonar
    assert (sonar.range_bins, sonar.azimuth_bins) == (400, 120)
    assert sonar.add_sigma == pytest.approx(0.2)
    assert sonar.mult_sigma == 0 and sonar.independent_beams  # HoloOcean's defaults, not ours


def test_description_reads_back(tmp_path: Path) -> None:
    sonar = ImagingSonar(range_bins=64, azimuth_bins=32, range_max=6, add_sigma=0.1, multi_path=True)
    path = tmp_path / "b.json"
    path.write_text(json.dumps(describe_scenario(sonar, "pier")), encoding="utf-8")
    again = read_scenario(path).sonar
    same = {"name", "rate_hz", "independent_beams"}
    assert again.model_dump(exclude=same) == sonar.model_dump(exclude=same)


@pytest.mark.parametrize(
    ("sensor", "configuration", "message"),
    [
        ({}, {"RangeMxa": 3}, "unknown sonar parameter 'RangeMxa'; known: RangeMin, RangeMax"),
        ({}, {"RangeMin": 5, "RangeMax": 2}, "RangeMin 5.0 must be below RangeMax 2.0"),
        ({}, {"Azimuth": "wide"}, "'Azimuth'"),
        ({}, {"AddSigma": -1}, "'AddSigma'"),
        ({}, {"RangeRes": 0}, "RangeRes: expected a number above zero, found 0"),
        ({}, {"AzimuthRes": "fine"}, "AzimuthRes: expected a number of zero or more, found 'fine'"),
        ({}, {"RangeMax": float("inf"), "RangeRes": 0.1}, "RangeMax"),
        ({}, {"RangeMax": float("nan")}, "RangeMax"),
        ({"configuration": [1]}, {}, "expected keys and values in the sonar's configuration, found list"),
        ({"rotation": "down"}, {}, "expected three numbers in the sonar's rotation, found 'down'"),
        ({"Hz": 0}, {}, "rate_hz"),
        ({"sensor_type": "RGBCamera"}, {}, "expected a sensor_type of ImagingSonar"),
    ],
)
def test_bad_scenario_is_one_clear_line(
    tmp_path: Path, sensor: dict[str, Any], configuration: dict[str, Any], message: str
) -> None:
    path = _write(tmp_path / "bad.json", sensor, **configuration)
    with pytest.raises(AsfmError, match=message) as caught:
        read_scenario(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[]", "3", '{"agents": []}', '{"agents": [{"sensors": 5}]}', "[" * 5000])
def test_what_is_no_scenario_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "none.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(AsfmError, match=r"none\.json"):
        simulate("tank", str(path))


def test_lever_arm_of_the_scenario_is_kept(tmp_path: Path) -> None:
    grid = {"RangeMin": 0.5, "RangeMax": 8, "RangeBins": 100, "AzimuthBins": 64, "Azimuth": 70, "Elevation": 12}
    path = _write(tmp_path / "a.json", {"location": [0.6, 0.1, -0.2], "rotation": [0, 30, 0], "Hz": 4}, **grid)
    simulated = simulate("tank", str(path), frame_count=3)
    bare = simulate("tank", str(_write(tmp_path / "b.json", {"Hz": 4}, **grid)), frame_count=3)
    mount = simulated.sequence.vehicle_from_sonar
    assert mount[:3, 3] == pytest.approx([0.6, 0.1, -0.2])
    assert simulated.sequence.groundtruth is not None and bare.sequence.groundtruth is not None
    # The sonar goes the same way; the vehicle around it is where the lever arm says.
    sonar_poses = bare.sequence.groundtruth.world_from_vehicle
    assert simulated.sequence.groundtruth.world_from_vehicle == pytest.approx(sonar_poses @ invert(mount))
    assert np.array_equal(simulated.read_truth(2).clean, bare.read_truth(2).clean)


def test_pickles_are_what_the_reader_reads(tmp_path: Path) -> None:
    simulated = simulate("tank", "holoocean", frame_count=3)
    steps: list[tuple[int, int]] = []
    write_pickles(tmp_path / "out", simulated, progress=lambda done, total: steps.append((done, total)))
    assert steps == [(1, 3), (2, 3), (3, 3)]
    again = open_sequence(tmp_path / "out")
    assert again.kind == "holoocean" and len(again) == 3
    assert np.array_equal(again.read_frame(1).image, simulated.sequence.read_frame(1).image)
    assert again.groundtruth is not None and simulated.sequence.groundtruth is not None
    assert again.groundtruth.world_from_vehicle == pytest.approx(simulated.sequence.groundtruth.world_from_vehicle)
    assert again.sonar.bearing_rad == pytest.approx(simulated.sequence.sonar.bearing_rad)
    assert again.sonar.range_m == pytest.approx(simulated.sequence.sonar.range_m)
    with pytest.raises(AsfmError, match="out"):
        write_pickles(tmp_path / "out", simulated)
    write_pickles(tmp_path / "out", simulated, overwrite=True)


def test_uneven_beams_cannot_be_pickled(tmp_path: Path) -> None:
    simulated = simulate("tank", "didson", frame_count=1)
    with pytest.raises(AsfmError, match="uneven beams"):
        write_pickles(tmp_path / "out", simulated)
    assert list(tmp_path.iterdir()) == []
    assert PRESETS["didson"].bearings_deg is not None
