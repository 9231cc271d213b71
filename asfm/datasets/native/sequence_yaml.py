"""Schema of sequence.yaml in the native folder: keys, units, defaults and bounds."""

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from asfm.errors import AsfmError, quote, shorten
from asfm.geometry.poses import pose_from_tum, tum_from_pose
from asfm.safe_yaml import read_yaml
from asfm.types import FloatArray, SensorNoise

Metres = Annotated[float, Field(ge=-1e5, le=1e5, allow_inf_nan=False)]
"""Rays and ranges beyond 100 km are in another unit."""
Unit = Annotated[float, Field(ge=-2, le=2, allow_inf_nan=False)]
Sigma = Annotated[float, Field(ge=1e-9, le=1e6, allow_inf_nan=False)]
MIN_SPAN_M, MIN_STEP_DEG = 1e-3, 1e-6
MAX_BEAMS = 100_000
Degrees = Annotated[float, Field(ge=-180, le=180)]


class StrictModel(BaseModel):
    """A mapping of sequence.yaml; an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class SonarSettings(StrictModel):
    """The sonar's pixel grid."""

    name: str = Field(default="unnamed sonar", max_length=200)
    range_m: tuple[Metres, Metres]
    """Near edge of row 0, far edge of the last row."""
    bearing_deg: tuple[Degrees, Degrees] | None = None
    """Outer edge of the first column, of the last column."""
    bearings_deg: tuple[Degrees, ...] | None = Field(default=None, max_length=MAX_BEAMS)
    """Centre of every column, where the beams are unevenly spaced."""
    elevation_aperture_deg: float = Field(ge=1e-3, le=180)
    decibel_span: float | None = Field(default=None, ge=1e-3, le=1000)
    """Decibels from black to white, where the images are logarithmic."""

    @model_validator(mode="after")
    def _check_edges(self) -> "SonarSettings":
        near, far = self.range_m
        if not (near >= 0 and far - near >= MIN_SPAN_M):
            bounds = f"0 <= near < far, {MIN_SPAN_M:g} m apart at least"
            raise ValueError(f"expected range_m: [near, far] with {bounds}, found {[near, far]}")
        if (self.bearing_deg is None) == (self.bearings_deg is None):
            raise ValueError("expected either bearing_deg (two outer edges) or bearings_deg (one a column)")
        if self.bearing_deg is not None and abs(self.bearing_deg[0] - self.bearing_deg[1]) < MIN_STEP_DEG:
            raise ValueError(f"expected two different bearing_deg, found {list(self.bearing_deg)}")
        if self.bearings_deg is not None:
            steps = np.diff(self.bearings_deg)
            if len(steps) == 0 or not (np.all(steps > MIN_STEP_DEG) or np.all(steps < -MIN_STEP_DEG)):
                raise ValueError("expected two or more bearings_deg that all increase or all decrease")
        return self


class MountSettings(StrictModel):
    """Mounting of the sonar: vehicle_from_sonar."""

    translation_m: tuple[Metres, Metres, Metres] = (0.0, 0.0, 0.0)
    quaternion_xyzw: tuple[Unit, Unit, Unit, Unit] = (0.0, 0.0, 0.0, 1.0)

    @model_validator(mode="after")
    def _check_rotation(self) -> "MountSettings":
        if abs(np.linalg.norm(self.quaternion_xyzw) - 1.0) > 0.1:
            raise ValueError(f"expected a unit quaternion, found {list(self.quaternion_xyzw)}")
        return self

    def pose(self) -> FloatArray:
        """Return vehicle_from_sonar, (4, 4), in metres."""
        return pose_from_tum(np.array([*self.translation_m, *self.quaternion_xyzw]))

    @classmethod
    def from_pose(cls, vehicle_from_sonar: FloatArray) -> "MountSettings":
        """Return the settings of vehicle_from_sonar, (4, 4), in metres."""
        row = [float(value) for value in tum_from_pose(vehicle_from_sonar)]
        return cls(translation_m=(row[0], row[1], row[2]), quaternion_xyzw=(row[3], row[4], row[5], row[6]))


class OdometryNoise(StrictModel):
    """Standard deviations of one step of the odometry."""

    translation_m: Sigma = SensorNoise.odometry_translation_m
    rotation_deg: Sigma = float(np.degrees(SensorNoise.odometry_rotation_rad))


class NavigationNoise(StrictModel):
    """Standard deviations of one reading of depth and attitude."""

    z_m: Sigma = SensorNoise.navigation_z_m
    roll_deg: Sigma = float(np.degrees(SensorNoise.navigation_roll_rad))
    pitch_deg: Sigma = float(np.degrees(SensorNoise.navigation_pitch_rad))


class NoiseSettings(StrictModel):
    """Noise of the sequence's own sensors."""

    odometry: OdometryNoise = OdometryNoise()
    navigation: NavigationNoise = NavigationNoise()

    def sensor_noise(self) -> SensorNoise:
        """Return the noise in radians."""
        return SensorNoise(
            odometry_translation_m=self.odometry.translation_m,
            odometry_rotation_rad=float(np.radians(self.odometry.rotation_deg)),
            navigation_z_m=self.navigation.z_m,
            navigation_roll_rad=float(np.radians(self.navigation.roll_deg)),
            navigation_pitch_rad=float(np.radians(self.navigation.pitch_deg)),
        )

    @classmethod
    def from_sensor_noise(cls, noise: SensorNoise) -> "NoiseSettings":
        """Return the settings, in degrees, of noise in radians."""
        odometry = OdometryNoise(
            translation_m=noise.odometry_translation_m, rotation_deg=float(np.degrees(noise.odometry_rotation_rad))
        )
        navigation = NavigationNoise(
            z_m=noise.navigation_z_m,
            roll_deg=float(np.degrees(noise.navigation_roll_rad)),
            pitch_deg=float(np.degrees(noise.navigation_pitch_rad)),
        )
        return cls(odometry=odometry, navigation=navigation)


class SequenceSettings(StrictModel):
    """The whole of sequence.yaml."""

    sonar: SonarSettings
    vehicle_from_sonar: MountSettings = MountSettings()
    noise: NoiseSettings = NoiseSettings()


def read_settings(path: Path) -> SequenceSettings:
    """Read and validate sequence.yaml.

    Raises:
        AsfmError: the file cannot be read, or a key is missing or unknown, or a value out of bounds.
    """
    settings = read_yaml(path, "the settings")
    try:
        return SequenceSettings.model_validate({} if settings is None else settings)
    except ValidationError as error:
        raise AsfmError(explain(error, str(path))) from None


def explain(error: ValidationError, where: str) -> str:
    """Return one line that names the first invalid key and the reason; ``where`` names the file."""
    first = error.errors(include_url=False, include_context=False)[0]
    name = ".".join(str(part) for part in first["loc"]) or "the file"
    if first["type"] == "extra_forbidden":
        return f"{where}: unknown key {quote(name)}: remove it or correct its name"
    if first["type"] == "missing":
        return f"{where}: expected the key {name!r}, found none"
    name = shorten(name)
    if first["type"] == "value_error":
        return f"{where}: {name}: {shorten(first['msg'].removeprefix('Value error, '), 200)}"
    return f"{where}: {name}: {shorten(first['msg'], 200)}, found {quote(first['input'])}"
