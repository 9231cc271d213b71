"""Schema of sequence.yaml in the native folder: keys, units, defaults and bounds."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from asfm.datasets.file_kinds import LFS_ADVICE, is_lfs_pointer
from asfm.errors import AsfmError
from asfm.geometry.poses import pose_from_tum, tum_from_pose
from asfm.types import FloatArray, SensorNoise

Number = Annotated[float, Field(allow_inf_nan=False)]
Sigma = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Degrees = Annotated[float, Field(ge=-180, le=180)]


class StrictModel(BaseModel):
    """A mapping of sequence.yaml; an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class SonarSettings(StrictModel):
    """The sonar's pixel grid."""

    name: str = "unnamed sonar"
    range_m: tuple[Number, Number]
    """Near edge of row 0, far edge of the last row."""
    bearing_deg: tuple[Degrees, Degrees] | None = None
    """Outer edge of the first column, of the last column."""
    bearings_deg: tuple[Degrees, ...] | None = None
    """Centre of every column, where the beams are unevenly spaced."""
    elevation_aperture_deg: float = Field(gt=0, le=180)
    decibel_span: float | None = Field(default=None, gt=0)
    """Decibels from black to white, where the images are logarithmic."""

    @model_validator(mode="after")
    def _check_edges(self) -> "SonarSettings":
        near, far = self.range_m
        if not 0 <= near < far:
            raise ValueError(f"expected range_m: [near, far] with 0 <= near < far, found {[near, far]}")
        if (self.bearing_deg is None) == (self.bearings_deg is None):
            raise ValueError("expected either bearing_deg (two outer edges) or bearings_deg (one a column)")
        if self.bearing_deg is not None and self.bearing_deg[0] == self.bearing_deg[1]:
            raise ValueError(f"expected two different bearing_deg, found {list(self.bearing_deg)}")
        if self.bearings_deg is not None:
            steps = np.diff(self.bearings_deg)
            if len(steps) == 0 or not (np.all(steps > 0) or np.all(steps < 0)):
                raise ValueError("expected two or more bearings_deg that all increase or all decrease")
        return self


class MountSettings(StrictModel):
    """Mounting of the sonar: vehicle_from_sonar."""

    translation_m: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)
    quaternion_xyzw: tuple[Number, Number, Number, Number] = (0.0, 0.0, 0.0, 1.0)

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
    try:
        text = path.read_text(encoding="utf-8")
        if is_lfs_pointer(text[:80].encode()):
            raise AsfmError(f"{path}: expected the settings, found {LFS_ADVICE}")
        settings: Any = yaml.safe_load(text)
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise AsfmError(f"{path}: cannot read the settings: {' '.join(str(error).split())}") from None
    try:
        return SequenceSettings.model_validate({} if settings is None else settings)
    except ValidationError as error:
        raise AsfmError(explain(error, str(path))) from None


def explain(error: ValidationError, where: str) -> str:
    """Return one line that names the first invalid key and the reason; ``where`` names the file."""
    first = error.errors()[0]
    name = ".".join(str(part) for part in first["loc"]) or "the file"
    if first["type"] == "extra_forbidden":
        return f"{where}: unknown key {name!r}: remove it or correct its name"
    if first["type"] == "missing":
        return f"{where}: expected the key {name!r}, found none"
    if first["type"] == "value_error":
        return f"{where}: {name}: {first['msg'].removeprefix('Value error, ')}"
    found = repr(first["input"])
    return f"{where}: {name}: {first['msg']}, found {found if len(found) < 80 else found[:77] + '...'}"
