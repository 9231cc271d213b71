"""Sensors of a HoloOcean scenario file (JSON): type, name, rate, mounting and configuration.

Recordings and the simulator read the same files: the choice of the imaging sonar and the checks are here.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, Field, ValidationError

from asfm.datasets.native.sequence_yaml import explain
from asfm.errors import AsfmError, join_quoted, quote, shorten
from asfm.geometry.poses import make_pose
from asfm.safe_json import read_json
from asfm.types import FloatArray

MAX_NUMBER = 1e6
"""No length, angle, rate or count of a scenario is larger, and no rate smaller than its inverse."""
SONAR_TYPE = "ImagingSonar"
POSE_TYPE = "PoseSensor"


class _ScenarioFile(BaseModel):
    main_agent: Any = None
    agents: list[Any]
    ds_factor: float = Field(1.0, ge=1e-6, le=1e6, allow_inf_nan=False)


@dataclass(frozen=True)
class Sensor:
    """One sensor of a scenario; its values are checked when they are used, since most sensors are not."""

    path: Path
    """The scenario file."""
    settings: dict[str, Any]
    """The sensor's keys as they are in the file."""

    @property
    def kind(self) -> str:
        """HoloOcean's sensor_type."""
        return shorten(str(self.settings.get("sensor_type"))[:200])

    @property
    def name(self) -> str:
        """Key of the sensor's readings in a recording: its sensor_name, by default its type."""
        return str(self.settings.get("sensor_name") or self.kind)

    @property
    def rate_hz(self) -> float | None:
        """Rate of the readings; None where the file does not state it."""
        value = self.settings.get("Hz")
        return None if value is None else check_number(value, f"{self.path}: Hz", positive=True)

    @property
    def configuration(self) -> dict[str, Any]:
        """Copy of the sensor's own parameters."""
        value = self.settings.get("configuration", {})
        if not isinstance(value, dict):
            raise AsfmError(
                f"{self.path}: expected keys and values in {self._owner} configuration, found {type(value).__name__}"
            )
        return dict(value)

    @property
    def vehicle_from_sensor(self) -> FloatArray:
        """(4, 4) from location (m) and rotation ([roll, pitch, yaw] about fixed axes, degrees) on the agent."""
        from scipy.spatial.transform import Rotation

        location_m, rotation_deg = self._triple("location"), self._triple("rotation")
        return make_pose(location_m, Rotation.from_euler("xyz", rotation_deg, degrees=True))

    def has_mounting_of(self, other: "Sensor") -> bool:
        """Return whether both sensors have the same socket, location and rotation."""
        return self.settings.get("socket") == other.settings.get("socket") and all(
            np.array_equal(self._triple(key), other._triple(key)) for key in ("location", "rotation")
        )

    @property
    def _owner(self) -> str:
        return "the sonar's" if self.kind == SONAR_TYPE else f"the {self.kind}'s"

    def _triple(self, key: str) -> FloatArray:
        value = self.settings.get(key, [0.0, 0.0, 0.0])
        try:
            triple = np.array(value, dtype=float)
        except (TypeError, ValueError, OverflowError):
            triple = np.empty(0)
        if triple.shape != (3,) or not (np.abs(triple) <= MAX_NUMBER).all():
            raise AsfmError(f"{self.path}: expected three numbers in {self._owner} {key}, found {quote(value)}")
        return triple


@dataclass(frozen=True)
class ScenarioSensors:
    """The sensors of all agents, those of the main agent first."""

    sonars: tuple[Sensor, ...]
    """The imaging sonars, at least one; the first is the one to use."""
    pose_sensor: Sensor | None
    """The first pose sensor."""
    length_scale: float
    """AONeuS's ds_factor: lengths of a recording are divided by it."""


def read_sensors(path: Path) -> ScenarioSensors:
    """Read the imaging sonars and the pose sensor of a scenario file.

    Raises:
        AsfmError: the file is missing, is no JSON or no scenario, or has no imaging sonar.
    """
    file = _load(path)
    agents = [agent for agent in file.agents if isinstance(agent, dict)]
    agents.sort(key=lambda agent: bool(agent.get("agent_name") != file.main_agent))
    lists = [agent.get("sensors") for agent in agents]
    entries = [entry for found in lists if isinstance(found, list) for entry in found if isinstance(entry, dict)]
    sensors = [Sensor(path, entry) for entry in entries]
    sonars = tuple(sensor for sensor in sensors if sensor.kind == SONAR_TYPE)
    if not sonars:
        others = join_quoted(sorted({sensor.kind for sensor in sensors})) or "no sensors"
        raise AsfmError(f"{path}: expected a sensor_type of {SONAR_TYPE}, found {others}")
    pose_sensor = next((sensor for sensor in sensors if sensor.kind == POSE_TYPE), None)
    return ScenarioSensors(sonars, pose_sensor, file.ds_factor)


def _load(path: Path) -> _ScenarioFile:
    content = read_json(path, "a HoloOcean scenario")
    try:
        return _ScenarioFile.model_validate(content)
    except ValidationError as error:
        is_scale = error.errors()[0]["loc"] == ("ds_factor",)
        where = str(path) if is_scale else f"{path}: expected a HoloOcean scenario with a list of agents"
        raise AsfmError(explain(error, where)) from None


def check_number(value: Any, where: str, positive: bool = False) -> float:
    """Return a finite number of zero or more, or above zero, read from JSON.

    Raises:
        AsfmError: it is something else; ``where`` begins the message.
    """
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not 0 <= value <= MAX_NUMBER or (positive and value < 1 / MAX_NUMBER):
        expected = "a number above zero" if positive else "a number of zero or more"
        expected += f", {MAX_NUMBER:g} at most" if is_number and MAX_NUMBER < value < float("inf") else ""
        raise AsfmError(f"{where}: expected {expected}, found {quote(value)}")
    return float(value)
