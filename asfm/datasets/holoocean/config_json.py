"""Config.json of a HoloOcean scenario: what a reader needs of its imaging sonar."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, Field, ValidationError

from asfm.datasets.native.sequence_yaml import explain
from asfm.errors import AsfmError

SONAR_TYPE = "ImagingSonar"
POSE_TYPE = "PoseSensor"


class _SonarConfiguration(BaseModel):
    """The sonar's ``configuration``; keys of the simulation are of no concern here."""

    Azimuth: float = Field(gt=0, le=360)
    Elevation: float = Field(gt=0, le=180)
    RangeMin: float = Field(ge=0, allow_inf_nan=False)
    RangeMax: float = Field(gt=0, allow_inf_nan=False)
    RangeBins: int | None = None
    AzimuthBins: int | None = None


class _Sensor(BaseModel):
    sensor_type: str
    sensor_name: str | None = None
    socket: str | None = None
    location: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    Hz: float | None = Field(None, gt=0, allow_inf_nan=False)
    configuration: dict[str, Any] = {}

    @property
    def name(self) -> str:
        """Key of its readings in a pickle."""
        return self.sensor_name or self.sensor_type


class _Agent(BaseModel):
    sensors: list[_Sensor] = []


class _Config(BaseModel):
    agents: list[_Agent]
    ds_factor: float = Field(1.0, gt=0, allow_inf_nan=False)


@dataclass(frozen=True)
class Scenario:
    """The imaging sonar of a scenario, in our units."""

    path: Path
    sonar_name: str
    pose_name: str
    pose_is_of_sonar: bool
    """The pose sensor sits where the sonar sits, turned alike."""
    rate_hz: float
    range_m: tuple[float, float]
    """Near edge of row 0, far edge of the last row, already divided by the scale."""
    azimuth_rad: float
    elevation_rad: float
    shape: tuple[int | None, int | None]
    """(ranges, beams) where the file states them."""
    scale: float
    """AONeuS's ds_factor: lengths are divided by it."""

    def check_shape(self, found: tuple[int, int], where: Path) -> None:
        """Raise AsfmError where an image is not of the size that the file states."""
        if any(stated is not None and stated != size for stated, size in zip(self.shape, found, strict=True)):
            raise AsfmError(f"{where}: expected {self.shape} (RangeBins, AzimuthBins) as in {self.path}, found {found}")


def read_scenario(path: Path) -> Scenario:
    """Read the first imaging sonar of Config.json.

    Raises:
        AsfmError: the file cannot be read, has no imaging sonar, or lacks a key of its geometry.
    """
    try:
        config = _Config.model_validate(json.loads(path.read_text(encoding="utf-8-sig")))
    except ValidationError as error:
        raise AsfmError(explain(error, str(path))) from None
    except (OSError, ValueError, RecursionError) as error:
        raise AsfmError(f"{path}: cannot read the scenario: {' '.join(str(error).split())}") from None
    sensors = [sensor for agent in config.agents for sensor in agent.sensors]
    sonar = next((sensor for sensor in sensors if sensor.sensor_type == SONAR_TYPE), None)
    if sonar is None:
        raise AsfmError(f"{path}: expected a sensor of type {SONAR_TYPE}, found {len(sensors)} others")
    pose = next((sensor for sensor in sensors if sensor.sensor_type == POSE_TYPE), None)
    try:
        geometry = _SonarConfiguration.model_validate(sonar.configuration)
    except ValidationError as error:
        raise AsfmError(explain(error, f"{path}, configuration of {sonar.name}")) from None
    if geometry.RangeMin >= geometry.RangeMax:
        raise AsfmError(f"{path}: expected RangeMin below RangeMax, found {geometry.RangeMin} and {geometry.RangeMax}")
    return Scenario(
        path=path,
        sonar_name=sonar.name,
        pose_name=pose.name if pose is not None else POSE_TYPE,
        pose_is_of_sonar=pose is None or _mount(pose) == _mount(sonar),
        rate_hz=sonar.Hz or 1.0,
        range_m=(geometry.RangeMin / config.ds_factor, geometry.RangeMax / config.ds_factor),
        azimuth_rad=float(np.radians(geometry.Azimuth)),
        elevation_rad=float(np.radians(geometry.Elevation)),
        shape=(geometry.RangeBins, geometry.AzimuthBins),
        scale=config.ds_factor,
    )


def _mount(sensor: _Sensor) -> tuple[str | None, tuple[float, ...], tuple[float, ...]]:
    return sensor.socket, sensor.location, sensor.rotation
