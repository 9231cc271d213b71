"""A HoloOcean scenario as the sonar's description.

Names, units and defaults are those of HoloOcean's ImagingSonar (its documentation of the sensor, and how its engine
uses the numbers). Its image is echo x (0.5 + N(0, MultSigma)) + Rayleigh(AddSigma), so that speckle's contrast is twice
MultSigma; ScaleNoise lets AddSigma grow with the square of range.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError
from asfm.geometry.poses import make_pose
from asfm.simulation.sonars.parameters import MAX_CELLS, ImagingSonar, parse_sonar
from asfm.types import FloatArray

ENGINE_KEYS = {
    "ClusterSize",
    "ElevationRes",
    "InitOctreeRange",
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

CONTRAST_PER_MULT_SIGMA = 2.0
SCALED_NOISE_EXPONENT = 2.0
SONAR_TYPE = "ImagingSonar"


@dataclass(frozen=True)
class Scenario:
    """What a scenario says of its imaging sonar."""

    sonar: ImagingSonar
    vehicle_from_sonar: FloatArray
    """(4, 4) from the sensor's location and rotation on the agent."""
    diagnostics: tuple[Diagnostic, ...] = ()
    """What of the scenario is not simulated."""


def read_scenario(path: Path) -> Scenario:
    """Read the first imaging sonar of a scenario: of the main agent if it has one, else of the first agent that has.

    Raises:
        AsfmError: no JSON, no imaging sonar, or a key or value of its configuration that is not HoloOcean's.
    """
    sensors = _list_sonars(path, _load(path))
    sensor, diagnostics = sensors[0], list[Diagnostic]()
    if len(sensors) > 1:
        message = f"{path} has {len(sensors)} imaging sonars: the first is simulated"
        diagnostics.append(Diagnostic("multiple-sonars", message))
    settings = {key: value for key, value in _mapping(path, sensor, "configuration").items() if key not in ENGINE_KEYS}
    if settings.pop("AzimuthStreaks", 0):
        diagnostics.append(Diagnostic("unsupported-setting", f"AzimuthStreaks of {path} is not simulated"))
    _convert_resolutions(path, settings)
    _convert_noise(path, settings)
    settings = HOLOOCEAN_DEFAULTS | settings
    if "Hz" in sensor:
        settings["rate_hz"] = _number(path, sensor["Hz"], "Hz", above_zero=True)
    if "name" not in settings:
        settings["name"] = str(sensor.get("sensor_name", "HoloOcean ImagingSonar"))
    return Scenario(parse_sonar(settings, str(path)), _mount(path, sensor), tuple(diagnostics))


def _load(path: Path) -> Any:
    if path.is_dir():
        raise AsfmError(f"{path}: expected a HoloOcean scenario, found a folder")
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise AsfmError(f"{path}: expected a HoloOcean scenario, found no file") from None
    except (OSError, ValueError, RecursionError) as error:
        raise AsfmError(f"{path}: cannot read a HoloOcean scenario: {' '.join(str(error).split())}") from None


def _list_sonars(path: Path, scenario: Any) -> list[dict[str, Any]]:
    """List the imaging sonars of all agents, those of the main agent first."""
    if not isinstance(scenario, dict) or not isinstance(scenario.get("agents"), list):
        raise AsfmError(f"{path}: expected a HoloOcean scenario with a list of agents, found none")
    agents = [agent for agent in scenario["agents"] if isinstance(agent, dict)]
    agents.sort(key=lambda agent: agent.get("agent_name") != scenario.get("main_agent"))
    lists = [agent.get("sensors") for agent in agents]
    sensors = [sensor for found in lists if isinstance(found, list) for sensor in found if isinstance(sensor, dict)]
    sonars = [sensor for sensor in sensors if sensor.get("sensor_type") == SONAR_TYPE]
    if not sonars:
        others = sorted({str(sensor.get("sensor_type")) for sensor in sensors})
        raise AsfmError(f"{path}: expected a sensor_type of {SONAR_TYPE}, found {', '.join(others) or 'no sensors'}")
    return sonars


def _mapping(path: Path, sensor: dict[str, Any], key: str) -> dict[str, Any]:
    value = sensor.get(key, {})
    if not isinstance(value, dict):
        raise AsfmError(f"{path}: expected keys and values in the sonar's {key}, found {type(value).__name__}")
    return dict(value)


def _convert_resolutions(path: Path, settings: dict[str, Any]) -> None:
    """Replace RangeRes and AzimuthRes, which HoloOcean takes instead of a number of bins: as many whole ones as fit."""
    default = ImagingSonar()
    stated = {"RangeMin": default.range_min, "RangeMax": default.range_max, "Azimuth": default.azimuth} | settings
    for name, high, low in (("Range", "RangeMax", "RangeMin"), ("Azimuth", "Azimuth", None)):
        if f"{name}Res" not in settings:
            continue
        _refuse_both(path, settings, f"{name}Bins", f"{name}Res")
        step = _number(path, settings.pop(f"{name}Res"), f"{name}Res", above_zero=True)
        span = _number(path, stated[high], high) - (_number(path, stated[low], low) if low else 0.0)
        settings[f"{name}Bins"] = int(np.clip(span / step + 1e-6, 0, MAX_CELLS))


def _convert_noise(path: Path, settings: dict[str, Any]) -> None:
    """Replace variances by sigmas, and what HoloOcean means by its noise by what the simulator means."""
    for name in ("Add", "Mult"):
        if f"{name}Cov" in settings:
            _refuse_both(path, settings, f"{name}Sigma", f"{name}Cov")
            settings[f"{name}Sigma"] = _number(path, settings.pop(f"{name}Cov"), f"{name}Cov") ** 0.5
    if "MultSigma" in settings:
        sigma = _number(path, settings["MultSigma"], "MultSigma")
        if sigma > 1 / CONTRAST_PER_MULT_SIGMA:
            raise AsfmError(
                f"{path}: MultSigma: expected 0.5 at most, where speckle is as strong as echoes, found {sigma}"
            )
        settings["MultSigma"] = CONTRAST_PER_MULT_SIGMA * sigma
    for switch in ("ScaleNoise", "MultiPath"):
        if switch in settings and settings[switch] not in (0, 1):  # False and True besides
            raise AsfmError(f"{path}: {switch}: expected true or false, found {settings[switch]!r}")
    if settings.pop("ScaleNoise", False):
        settings.setdefault("noise_range_exponent", SCALED_NOISE_EXPONENT)


def _refuse_both(path: Path, settings: dict[str, Any], one: str, other: str) -> None:
    if one in settings:
        raise AsfmError(f"{path}: expected {one} or {other}, found both")


def _number(path: Path, value: Any, key: str, above_zero: bool = False) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value)
    if not is_number or value < 0 or (above_zero and value == 0):
        expected = "a number above zero" if above_zero else "a number of zero or more"
        raise AsfmError(f"{path}: {key}: expected {expected}, found {value!r}")
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
