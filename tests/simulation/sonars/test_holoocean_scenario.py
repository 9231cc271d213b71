"""HoloOcean scenarios converted to parameters of the simulated sonar."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from asfm.errors import AsfmError
from asfm.geometry.poses import invert
from asfm.simulation.acoustics.noise import add_noise
from asfm.simulation.simulate import simulate
from asfm.simulation.sonars.holoocean_scenario import read_mounted_sonar
from asfm.simulation.sonars.parameters import make_sonar_model


def _write(path: Path, sensor: dict[str, Any] | None = None, **configuration: Any) -> Path:
    sonar = {"sensor_type": "ImagingSonar", "configuration": configuration, **(sensor or {})}
    scenario = {"name": "test", "agents": [{"sensors": [{"sensor_type": "PoseSensor"}, sonar]}]}
    path.write_text(json.dumps(scenario), encoding="utf-8")
    return path


def test_scenario_of_a_public_recording_is_read(shared_data: Path) -> None:
    scenario = read_mounted_sonar(shared_data / "holoocean_boat" / "Config.json")
    sonar = scenario.sonar
    assert (sonar.range_bins, sonar.azimuth_bins, sonar.range_max) == (512, 96, 8.0)
    assert (sonar.azimuth, sonar.elevation, sonar.add_sigma, sonar.mult_sigma) == (28.8, 14.0, 0.15, 0.4)
    assert sonar.noise_range_exponent == 2  # ScaleNoise
    assert [found.code for found in scenario.diagnostics] == ["unsupported-setting"]
    assert "AzimuthStreaks" in scenario.diagnostics[0].message
    assert sonar.multi_path and sonar.rate_hz == 1
    forward = scenario.vehicle_from_sonar[:3, 0]
    assert forward == pytest.approx([np.sqrt(0.5), 0, -np.sqrt(0.5)])  # pitched down by 45 deg about the left axis


def test_resolutions_and_covariances_become_bins_and_sigmas(tmp_path: Path) -> None:
    path = _write(tmp_path / "a.json", RangeMin=1, RangeMax=5, RangeRes=0.01, Azimuth=60, AzimuthRes=0.5, AddCov=0.04)
    sonar = read_mounted_sonar(path).sonar
    assert (sonar.range_bins, sonar.azimuth_bins) == (400, 120)
    assert sonar.add_sigma == pytest.approx(0.2)
    assert sonar.mult_sigma == 0 and sonar.independent_beams  # HoloOcean's defaults, not ours


@pytest.mark.parametrize(
    ("sensor", "configuration", "message"),
    [
        ({}, {"RangeMxa": 3}, "unknown sonar parameter 'RangeMxa'; known: RangeMin, RangeMax"),
        ({}, {"RangeMin": 5, "RangeMax": 2}, "RangeMin 5.0 must be below RangeMax 2.0"),
        ({}, {"Azimuth": "wide"}, "'Azimuth'"),
        ({}, {"AddSigma": -1}, "'AddSigma'"),
        ({}, {"RangeRes": 0}, "RangeRes: expected a number above zero, found 0"),
        ({}, {"AzimuthRes": "fine"}, "AzimuthRes: expected a number above zero, found 'fine'"),
        ({}, {"RangeBins": 64, "RangeRes": 0.1}, "expected RangeBins or RangeRes, found both"),
        ({}, {"AddSigma": 0.1, "AddCov": 0.01}, "expected AddSigma or AddCov, found both"),
        ({}, {"MultSigma": 0.6}, "MultSigma: expected 0.5 at most, .* found 0.6"),
        ({}, {"MultSigma": "loud"}, "MultSigma: expected a number of zero or more, found 'loud'"),
        ({}, {"MultiPath": "yes"}, "MultiPath: expected true or false, found 'yes'"),
        ({}, {"RangeMax": "8"}, "'RangeMax': expected a number, found '8'"),
        ({}, {"RangeMax": True}, "'RangeMax': expected a number, found true"),
        ({}, {"RangeMax": None}, "'RangeMax': expected a valid number, found None"),
        ({}, {"RangeBins": 10.5}, "'RangeBins': .* found 10.5"),
        ({}, {"RangeBins": 10**7, "AzimuthBins": 10**6}, "is more than 20000000"),
        ({}, {"ElevationBins": 10**8}, "AzimuthBins 512 x ElevationBins 100000000 is more than"),
        ({}, {"Azimuth": 360}, "'Azimuth': expected less than 180, found 360"),
        ({}, {"RangeMax": float("inf"), "RangeRes": 0.1}, "RangeMax"),
        ({}, {"RangeMax": float("nan")}, "RangeMax"),
        ({"configuration": [1]}, {}, "expected keys and values in the sonar's configuration, found list"),
        ({"rotation": "down"}, {}, "expected three numbers in the sonar's rotation, found 'down'"),
        ({"Hz": 0}, {}, "Hz: expected a number above zero, found 0"),
        ({"Hz": "fast"}, {}, "Hz: expected a number above zero, found 'fast'"),
        ({"location": [1, 2]}, {}, "expected three numbers in the sonar's location"),
        ({"configuration": None}, {}, "configuration, found NoneType"),
        (
            {"sensor_type": "RGBCamera"},
            {},
            "expected a sensor_type of ImagingSonar, found PoseSensor, RGBCamera",
        ),
    ],
)
def test_invalid_scenario_is_one_line_with_file_key_and_value(
    tmp_path: Path, sensor: dict[str, Any], configuration: dict[str, Any], message: str
) -> None:
    path = _write(tmp_path / "bad.json", sensor, **configuration)
    with pytest.raises(AsfmError, match=message) as caught:
        read_mounted_sonar(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[]", "3", '{"agents": []}', '{"agents": [{"sensors": 5}]}', "[" * 5000])
def test_files_without_a_scenario_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "none.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(AsfmError, match=r"none\.json"):
        simulate("tank", str(path))


REALISTIC: dict[str, Any] = {
    "name": "HarbourSurvey",
    "package_name": "Ocean",
    "world": "PierHarbor",
    "main_agent": "rov",
    "ticks_per_sec": 200,
    "frames_per_sec": 30,
    "octree_min": 0.02,
    "octree_max": 5.0,
    "agents": [
        {
            "agent_name": "chaser",
            "agent_type": "TorpedoAUV",
            "sensors": [{"sensor_type": "SidescanSonar", "configuration": {"Azimuth": 170, "RangeBins": 2000}}],
            "control_scheme": 0,
            "location": [10, 4, -6],
            "rotation": [0, 0, 90],
        },
        {
            "agent_name": "rov",
            "agent_type": "HoveringAUV",
            "sensors": [
                {"sensor_type": "PoseSensor", "socket": "SonarSocket"},
                {"sensor_type": "DVLSensor", "socket": "DVLSocket", "Hz": 20, "configuration": {"Elevation": 22.5}},
                {"sensor_type": "IMUSensor", "socket": "IMUSocket", "Hz": 200, "configuration": {"ReturnBias": True}},
                {
                    "sensor_type": "ImagingSonar",
                    "sensor_name": "Front",
                    "socket": "SonarSocket",
                    "location": [0.3, 0.0, -0.1],
                    "rotation": [0.0, 20.0, 0.0],
                    "Hz": 10,
                    "lcm_channel": "SONAR",
                    "configuration": {
                        "Azimuth": 90,
                        "Elevation": 16,
                        "ElevationRes": 0.5,
                        "RangeMin": 0.5,
                        "RangeMax": 8,
                        "RangeRes": 0.05,
                        "AzimuthBins": 128,
                        "AddSigma": 0.05,
                        "MultSigma": 0.15,
                        "RangeSigma": 0.02,
                        "MultiPath": 1,
                        "ClusterSize": 5,
                        "ScaleNoise": True,
                        "AzimuthStreaks": 0,
                        "ShowWarning": True,
                        "InitOctreeRange": 50,
                        "ViewRegion": False,
                        "ViewOctree": -10,
                        "ShadowEpsilon": 0.08,
                        "WaterDensity": 997,
                        "WaterSpeedSound": 1480,
                        "UseApprox": True,
                    },
                },
            ],
            "control_scheme": 1,
            "location": [0, 0, -5],
            "rotation": [0, 0, 0],
        },
    ],
}


def test_realistic_scenario_is_read_completely_and_simulated(tmp_path: Path) -> None:
    path = tmp_path / "survey.json"
    path.write_text(json.dumps(REALISTIC), encoding="utf-8")
    scenario = read_mounted_sonar(path)
    sonar = scenario.sonar
    assert (sonar.name, sonar.rate_hz, sonar.range_bins, sonar.azimuth_bins) == ("Front", 10, 150, 128)
    assert (sonar.add_sigma, sonar.mult_sigma, sonar.range_sigma, sonar.multi_path) == (0.05, 0.3, 0.02, True)
    assert sonar.noise_range_exponent == 2 and scenario.diagnostics == ()
    assert scenario.vehicle_from_sonar[:3, 3] == pytest.approx([0.3, 0.0, -0.1])
    simulated = simulate("tank", str(path), frame_count=2)
    assert simulated.sequence.read_frame(1).image.shape == (150, 128)
    assert simulated.sequence.sonar.range_edges_m[[0, -1]] == pytest.approx([0.5, 8.0])


def test_first_sonar_of_the_main_agent_is_simulated_with_a_diagnostic(tmp_path: Path) -> None:
    first, second = ({"sensor_type": "ImagingSonar", "configuration": {"RangeMax": reach}} for reach in (3, 7))
    agents = [{"agent_name": "a", "sensors": [first]}, {"agent_name": "b", "sensors": [second]}]
    path = tmp_path / "two.json"
    for main, reach in (("a", 3), ("b", 7), ("none", 3)):
        path.write_text(json.dumps({"main_agent": main, "agents": agents}), encoding="utf-8")
        scenario = read_mounted_sonar(path)
        assert scenario.sonar.range_max == reach
        assert [found.code for found in scenario.diagnostics] == ["multiple-sonars"]
        assert f"{path} has 2 imaging sonars" in scenario.diagnostics[0].message
    assert simulate("tank", str(path), frame_count=1).sequence.diagnostics[0] == scenario.diagnostics[0]


def test_noise_follows_holooceans_formula(tmp_path: Path) -> None:
    """Documented formula: echo x (0.5 + normal) + Rayleigh x (range / RangeMax)^2 with ScaleNoise."""
    rng = np.random.default_rng(0)
    keys: dict[str, Any] = {"RangeBins": 400, "AzimuthBins": 256, "AddSigma": 0.08, "MultSigma": 0.1}
    sonar = read_mounted_sonar(_write(tmp_path / "a.json", ScaleNoise=True, **keys)).sonar
    model = make_sonar_model(sonar)
    theirs = 0.4 * (0.5 + 0.1 * rng.standard_normal(model.shape))
    quiet = sonar.model_copy(update={"add_sigma": 0.0})
    ours = add_noise(np.full(model.shape, 0.2, dtype=np.float32), quiet, model, rng)
    assert ours.mean() == pytest.approx(theirs.mean(), rel=0.01)
    assert ours.std() == pytest.approx(theirs.std(), rel=0.02)
    normal = rng.standard_normal((2, *model.shape))
    theirs = 0.08 * np.hypot(*normal) * (model.range_m[:, None] / sonar.range_max) ** 2
    ours = add_noise(np.zeros(model.shape, dtype=np.float32), sonar, model, rng)
    for rows in (slice(100, 120), slice(380, 400)):
        assert stats.ks_2samp(ours[rows].ravel(), theirs[rows].ravel()).pvalue > 0.01


def test_lever_arm_of_the_scenario_moves_the_vehicle_not_the_sonar(tmp_path: Path) -> None:
    grid = {"RangeMin": 0.5, "RangeMax": 8, "RangeBins": 100, "AzimuthBins": 64, "Azimuth": 70, "Elevation": 12}
    path = _write(tmp_path / "a.json", {"location": [0.6, 0.1, -0.2], "rotation": [0, 30, 0], "Hz": 4}, **grid)
    simulated = simulate("tank", str(path), frame_count=3)
    bare = simulate("tank", str(_write(tmp_path / "b.json", {"Hz": 4}, **grid)), frame_count=3)
    mount = simulated.sequence.vehicle_from_sonar
    assert mount[:3, 3] == pytest.approx([0.6, 0.1, -0.2])
    assert simulated.sequence.groundtruth is not None and bare.sequence.groundtruth is not None
    # The sonar moves along the same path; the vehicle's poses follow from the lever arm.
    sonar_poses = bare.sequence.groundtruth.world_from_vehicle
    assert simulated.sequence.groundtruth.world_from_vehicle == pytest.approx(sonar_poses @ invert(mount))
    assert np.array_equal(simulated.read_truth(2).clean, bare.read_truth(2).clean)
