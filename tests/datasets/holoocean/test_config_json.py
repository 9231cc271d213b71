"""Config.json of a HoloOcean recording: geometry in metres and radians, scale, mounting of the pose sensor."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asfm.datasets.holoocean.config_json import DEFAULT_RATE_HZ, Scenario, read_scenario
from asfm.errors import AsfmError
from tests.datasets.holoocean_files import GEOMETRY, SHAPE, make_config


def _read(folder: Path, **changes: Any) -> Scenario:
    (folder / "Config.json").write_text(json.dumps(make_config(**changes)))
    return read_scenario(folder / "Config.json")


def test_geometry_is_in_metres_and_radians(tmp_path: Path) -> None:
    scenario = _read(tmp_path)
    assert scenario.range_m == (0.5, 4.5) and scenario.shape == SHAPE and scenario.rate_hz == 4
    np.testing.assert_allclose(np.degrees([scenario.azimuth_rad, scenario.elevation_rad]), [60, 12])
    assert (scenario.sonar_name, scenario.pose_name) == ("ImagingSonar", "PoseSensor") and scenario.pose_is_of_sonar


def test_a_pose_sensor_mounted_elsewhere_is_not_that_of_the_sonar(tmp_path: Path) -> None:
    assert not _read(tmp_path, pose={"rotation": [0, 0, 0]}).pose_is_of_sonar


def test_a_missing_rate_is_the_default_one(tmp_path: Path) -> None:
    assert _read(tmp_path, sonar={"Hz": None}).rate_hz == DEFAULT_RATE_HZ


def test_an_image_of_another_shape_is_reported_with_its_place(tmp_path: Path) -> None:
    scenario = _read(tmp_path)
    scenario.check_shape(SHAPE, Path("3.pkl"))
    with pytest.raises(AsfmError, match=r"^3\.pkl: expected \(16, 6\).*found \(16, 7\)$"):
        scenario.check_shape((16, 7), Path("3.pkl"))
    unstated = {key: value for key, value in GEOMETRY.items() if not key.endswith("Bins")}
    _read(tmp_path, sonar={"configuration": unstated}).check_shape((16, 7), Path("3.pkl"))


def test_an_empty_range_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(AsfmError, match=r"expected RangeMin below RangeMax, found 4\.5 and 4\.5"):
        _read(tmp_path, sonar={"configuration": {**GEOMETRY, "RangeMin": 4.5}})
