"""Sensors of a scenario file: choice of the imaging sonar, mounting, and values that are refused."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asfm.datasets.holoocean.config_json import read_scenario
from asfm.datasets.holoocean.scenario_sensors import Sensor, check_number, read_sensors
from asfm.errors import AsfmError
from asfm.geometry.poses import transform
from asfm.simulation.sonars.holoocean_scenario import read_mounted_sonar


def make_sonar(range_max: float, **changes: Any) -> dict[str, Any]:
    geometry = {"RangeMin": 1, "RangeMax": range_max, "Azimuth": 60, "Elevation": 12}
    return {"sensor_type": "ImagingSonar", "configuration": geometry, **changes}


def write_file(path: Path, *sensors: dict[str, Any], **keys: Any) -> Path:
    path.write_text(json.dumps({"agents": [{"sensors": list(sensors)}], **keys}), encoding="utf-8")
    return path


@pytest.mark.parametrize(("main", "range_max"), [("a", 3), ("b", 7), ("none", 3)])
def test_sonar_is_that_of_the_main_agent_in_recordings_and_in_the_simulator(
    tmp_path: Path, main: str, range_max: float
) -> None:
    agents = [{"agent_name": name, "sensors": [make_sonar(reach)]} for name, reach in (("a", 3), ("b", 7))]
    path = tmp_path / "Config.json"
    path.write_text(json.dumps({"main_agent": main, "agents": agents}), encoding="utf-8")
    assert read_sensors(path).sonars[0].configuration["RangeMax"] == range_max
    assert read_scenario(path).range_m == (1, range_max)
    assert read_mounted_sonar(path).sonar.range_max == range_max


def test_agents_and_sensors_that_are_no_objects_are_skipped(tmp_path: Path) -> None:
    path = tmp_path / "Config.json"
    agents = [7, {"sensors": None}, {"sensors": [3, {"sensor_type": "PoseSensor", "sensor_name": "p"}, make_sonar(5)]}]
    path.write_text(json.dumps({"agents": agents}), encoding="utf-8")
    sensors = read_sensors(path)
    assert len(sensors.sonars) == 1 and sensors.length_scale == 1
    assert sensors.pose_sensor is not None and sensors.pose_sensor.name == "p"


def test_name_and_rate_have_defaults(tmp_path: Path) -> None:
    bare = read_sensors(write_file(tmp_path / "a.json", make_sonar(5))).sonars[0]
    assert (bare.name, bare.rate_hz) == ("ImagingSonar", None)
    named = read_sensors(write_file(tmp_path / "b.json", make_sonar(5, sensor_name="Front", Hz=4))).sonars[0]
    assert (named.name, named.rate_hz) == ("Front", 4.0)


@pytest.mark.parametrize(
    ("rotation_deg", "forward"),
    [([0, 0, 90], [0, 1, 0]), ([0, 90, 0], [0, 0, -1]), ([30, 0, 0], [1, 0, 0])],
)
def test_mounting_turns_the_sonar_by_roll_pitch_and_yaw(rotation_deg: list[float], forward: list[float]) -> None:
    sensor = Sensor(Path("a.json"), make_sonar(5, location=[1, 2, 3], rotation=rotation_deg))
    ahead = transform(sensor.vehicle_from_sensor, np.array([1.0, 0, 0]))
    assert ahead - [1, 2, 3] == pytest.approx(forward, abs=1e-12)


@pytest.mark.parametrize(
    ("changes", "same"),
    [
        ({}, True),
        ({"location": [0, 0, 0.0]}, True),
        ({"socket": "Other"}, False),
        ({"location": [0, 0, 0.1]}, False),
        ({"rotation": [0, 1, 0]}, False),
    ],
)
def test_mountings_are_compared_by_socket_location_and_rotation(changes: dict[str, Any], same: bool) -> None:
    sonar = Sensor(Path("a.json"), make_sonar(5, socket="S"))
    pose_sensor = Sensor(Path("a.json"), {"sensor_type": "PoseSensor", "socket": "S", **changes})
    assert pose_sensor.has_mounting_of(sonar) is sonar.has_mounting_of(pose_sensor) is same


def test_invalid_mounting_names_the_sensor(tmp_path: Path) -> None:
    pose = {"sensor_type": "PoseSensor", "rotation": "down"}
    path = write_file(tmp_path / "Config.json", pose, make_sonar(5))
    with pytest.raises(AsfmError, match=r"Config\.json: expected three numbers in the PoseSensor's rotation, found 'd"):
        read_scenario(path)
    assert read_mounted_sonar(path).sonar.range_max == 5  # the simulator does not use the pose sensor


@pytest.mark.parametrize("value", [-1, True, "4", None, float("nan"), float("inf")])
def test_numbers_are_finite_and_not_negative(value: object) -> None:
    with pytest.raises(AsfmError, match="here: expected a number of zero or more, found"):
        check_number(value, "here")
    assert check_number(0, "here") == 0.0
    with pytest.raises(AsfmError, match="here: expected a number above zero, found 0"):
        check_number(0, "here", positive=True)
