"""A HoloOcean scenario as the sonar's description."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from asfm.errors import AsfmError
from asfm.poses import make_pose
from asfm.simulation.sensor import ImagingSonar, parse_sonar
from asfm.types import FloatArray

ENGINE_KEYS = {
    "AzimuthStreaks",
    "ClusterSize",
    "ElevationRes",
    "InitOctreeRange",
    "ScaleNoise",
    "ShadowEpsilon",
    "ShowWarning",
    "ShowWaring",
    "UseApprox",
    "ViewOctree",
    "ViewRegion",
    "WaterDensity",
    "WaterSoundSpeed",
    "WaterSpeedSound",
}
"""What HoloOcean's octree and its drawing need and rays do not."""

HOLOOCEAN_DEFAULTS = {"AddSigma": 0.0, "MultSigma": 0.0, "independent_beams": True}
"""Where a key is missing, HoloOcean's own default rather than ours."""


@dataclass(frozen=True)
class Scenario:
    """What a scenario says of its imaging sonar."""

    sonar: ImagingSonar
    vehicle_from_sonar: FloatArray
    """(4, 4) from the sensor's location and rotation on the agent."""


def read_scenario(path: Path) -> Scenario:
    """Read the first imaging sonar of a scenario's first agent.

    Raises:
        AsfmError: no JSON, no imaging sonar, or a key or value of its configuration that is not HoloOcean's.
    """
    try:
        scenario = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise AsfmError(f"{path}: cannot read a HoloOcean scenario: {' '.join(str(error).split())}") from None
    sensor = _find_sonar(path, scenario)
    settings = {key: value for key, value in _mapping(path, sensor, "configuration").items() if key not in ENGINE_KEYS}
    _convert_resolutions(path, settings)
    for name in ("Add", "Mult"):
        if f"{name}Cov" in settings:
            settings[f"{name}Sigma"] = _number(path, settings.pop(f"{name}Cov"), f"{name}Cov") ** 0.5
    settings = HOLOOCEAN_DEFAULTS | settings
    if "Hz" in sensor:
        settings["rate_hz"] = sensor["Hz"]
    if "name" not in settings:
        settings["name"] = str(sensor.get("sensor_name", "HoloOcean ImagingSonar"))
    return Scenario(parse_sonar(settings, str(path)), _mount(path, sensor))


def _find_sonar(path: Path, scenario: Any) -> dict[str, Any]:
    try:
        sensors = scenario["agents"][0]["sensors"]
        return next(dict(sensor) for sensor in sensors if sensor["sensor_type"] == "ImagingSonar")
    except (KeyError, IndexError, TypeError, ValueError, StopIteration):
        raise AsfmError(f"{path}: expected a sensor_type of ImagingSonar in agents[0].sensors, found none") from None


def _mapping(path: Path, sensor: dict[str, Any], key: str) -> dict[str, Any]:
    value = sensor.get(key, {})
    if not isinstance(value, dict):
        raise AsfmError(f"{path}: expected keys and values in the sonar's {key}, found {type(value).__name__}")
    return dict(value)


def _convert_resolutions(path: Path, settings: dict[str, Any]) -> None:
    """Replace RangeRes and AzimuthRes, which HoloOcean takes instead of a number of bins."""
    default = ImagingSonar()
    stated = {"RangeMin": default.range_min, "RangeMax": default.range_max, "Azimuth": default.azimuth} | settings
    for name, high, low in (("Range", "RangeMax", "RangeMin"), ("Azimuth", "Azimuth", None)):
        if f"{name}Res" not in settings:
            continue
        step = _number(path, settings.pop(f"{name}Res"), f"{name}Res")
        if step == 0:
            raise AsfmError(f"{path}: {name}Res: expected a number above zero, found 0")
        span = _number(path, stated[high], high) - (_number(path, stated[low], low) if low else 0.0)
        settings.setdefault(f"{name}Bins", round(span / step))


def _number(path: Path, value: Any, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value) or value < 0:
        raise AsfmError(f"{path}: {key}: expected a number of zero or more, found {value!r}")
    return float(value)


def _mount(path: Path, sensor: dict[str, Any]) -> FloatArray:
    """Turn location and rotation ([roll, pitch, yaw] about fixed axes, degrees) into vehicle_from_sonar."""
    from scipy.spatial.transform import Rotation

    triples = []
    for key in ("location", "rotation"):
        value = sensor.get(key, [0.0, 0.0, 0.0])
        try:
            triple = np.array(value, dtype=float)
        except (TypeError, ValueError):
            triple = np.empty(0)
        if triple.shape != (3,) or not np.isfinite(triple).all():
            raise AsfmError(f"{path}: expected three numbers in the sonar's {key}, found {value!r}")
        triples.append(triple)
    return make_pose(triples[0], Rotation.from_euler("xyz", triples[1], degrees=True))
