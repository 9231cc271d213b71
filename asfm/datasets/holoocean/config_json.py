"""Config.json of a HoloOcean recording: geometry, rate and names of its imaging sonar and pose sensor."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import BaseModel, Field, ValidationError

from asfm.datasets.holoocean.scenario_sensors import POSE_TYPE, Sensor, read_sensors
from asfm.datasets.native.sequence_yaml import explain
from asfm.errors import AsfmError

DEFAULT_RATE_HZ = 1.0
MIN_SPAN_M = 1e-3


class _SonarGeometry(BaseModel):
    """The geometry in the sonar's ``configuration``; keys of the noise and of the engine are ignored."""

    Azimuth: float = Field(ge=1e-3, le=360)
    Elevation: float = Field(ge=1e-3, le=180)
    RangeMin: float = Field(ge=0, le=1e5, allow_inf_nan=False)
    RangeMax: float = Field(ge=1e-3, le=1e5, allow_inf_nan=False)
    RangeBins: int | None = None
    AzimuthBins: int | None = None


@dataclass(frozen=True)
class Scenario:
    """The imaging sonar of a recording, in metres and radians."""

    path: Path
    sonar_name: str
    """Key of the sonar's images in a pickle."""
    pose_name: str
    """Key of the poses in a pickle."""
    pose_is_of_sonar: bool
    """Whether the pose sensor has the sonar's socket, location and rotation."""
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
        """Check that an image has the (ranges, beams) that the file states.

        Raises:
            AsfmError: it has another shape; the message names ``where`` it was found.
        """
        if any(stated is not None and stated != size for stated, size in zip(self.shape, found, strict=True)):
            raise AsfmError(f"{where}: expected {self.shape} (RangeBins, AzimuthBins) as in {self.path}, found {found}")


def read_scenario(path: Path) -> Scenario:
    """Read the imaging sonar of a recording: the main agent's first, by default the first of any agent.

    Raises:
        AsfmError: the file cannot be read, has no imaging sonar, or lacks a key of its geometry.
    """
    sensors = read_sensors(path)
    sonar, pose_sensor, scale = sensors.sonars[0], sensors.pose_sensor, sensors.length_scale
    geometry = _read_geometry(path, sonar)
    return Scenario(
        path=path,
        sonar_name=sonar.name,
        pose_name=pose_sensor.name if pose_sensor is not None else POSE_TYPE,
        pose_is_of_sonar=pose_sensor is None or pose_sensor.has_mounting_of(sonar),
        rate_hz=sonar.rate_hz or DEFAULT_RATE_HZ,
        range_m=(geometry.RangeMin / scale, geometry.RangeMax / scale),
        azimuth_rad=float(np.radians(geometry.Azimuth)),
        elevation_rad=float(np.radians(geometry.Elevation)),
        shape=(geometry.RangeBins, geometry.AzimuthBins),
        scale=scale,
    )


def _read_geometry(path: Path, sonar: Sensor) -> _SonarGeometry:
    try:
        geometry = _SonarGeometry.model_validate(sonar.configuration)
    except ValidationError as error:
        raise AsfmError(explain(error, f"{path}, configuration of {sonar.name}")) from None
    if geometry.RangeMax - geometry.RangeMin < MIN_SPAN_M:
        raise AsfmError(f"{path}: expected RangeMin below RangeMax, found {geometry.RangeMin} and {geometry.RangeMax}")
    return geometry
