"""Parameters of the simulated imaging sonar, with HoloOcean's parameter names as aliases."""

from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from asfm.errors import AsfmError, quote
from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray


def _holoocean_name(field: str) -> str:
    """Return HoloOcean's name of a field: range_min -> RangeMin."""
    return "".join(part.capitalize() for part in field.split("_"))


MAX_CELLS = 20_000_000
"""Largest number of rays, or of pixels, of one ping: limited by a laptop's memory."""
MIN_SPAN_M = 1e-3
Bearing = Annotated[float, Field(ge=-90, le=90)]
TEXT_KEYS = {"name", "Name"}
SWITCH_KEYS = {"multi_path", "MultiPath", "independent_beams", "IndependentBeams"}


class ImagingSonar(BaseModel):
    """One imaging sonar: pixel grid, beams, echo model and noise.

    Fields are HoloOcean's ImagingSonar parameters in snake case (``range_bins`` is ``RangeBins``; both names are
    accepted); units are HoloOcean's: metres and degrees. Fields after ``multi_path`` are asfm's own.
    """

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        populate_by_name=True,
        alias_generator=_holoocean_name,
        allow_inf_nan=False,
    )

    range_min: float = Field(default=0.1, ge=0, le=1e5)
    """Near edge of the first row, m."""
    range_max: float = Field(default=10.0, ge=1e-3, le=1e5)
    """Far edge of the last row, m."""
    range_bins: int = Field(default=512, ge=2, le=2**40)
    azimuth: float = Field(default=120.0, ge=1e-3, lt=180)
    """Full horizontal aperture, deg."""
    azimuth_bins: int = Field(default=512, ge=2, le=2**40)
    elevation: float = Field(default=20.0, ge=1e-3, lt=180)
    """Full elevation aperture, deg."""
    elevation_bins: int = Field(default=420, ge=2, le=2**40)
    """Rays cast per beam."""
    add_sigma: float = Field(default=0.04, ge=0, le=100)
    """Scale of the additive Rayleigh noise, in image units (1 is white)."""
    mult_sigma: float = Field(default=0.35, ge=0, le=1)
    """Contrast (standard deviation over mean) of the multiplicative speckle."""
    range_sigma: float = Field(default=0.0, ge=0, le=1e5)
    """Mean of the exponentially distributed range delay of single echoes, m."""
    multi_path: bool = False
    """Add the echoes of a second bounce after a specular reflection."""

    name: str = "imaging sonar"
    rate_hz: float = Field(default=5.0, ge=1e-6, le=1e6)
    bearings_deg: tuple[Bearing, ...] | None = None
    """Centre of every beam where they are spaced unevenly, starboard (negative) to port; replaces ``azimuth``."""
    beam_width_deg: float | None = Field(default=None, ge=1e-6, le=360)
    """Beam width at half power (two-way); by default one column."""
    pulse_length_m: float | None = Field(default=None, ge=1e-9, le=1e5)
    """Length of the compressed pulse at half power; by default one row."""
    side_lobe_db: float = Field(default=-32.0, ge=-300, le=0)
    """First side lobe relative to the main lobe, two-way power."""
    cross_talk_db: float = Field(default=-48.0, ge=-300, le=0)
    """Share of the mean power over all beams at the same range that leaks into each beam."""
    azimuth_edge_db: float = Field(default=-3.0, ge=-300, le=0)
    """Two-way power at the outermost beams relative to the axis."""
    elevation_edge_db: float = Field(default=-6.0, ge=-300, le=0)
    """Two-way power at the edges of the elevation aperture relative to the axis."""
    specular_strength: float = Field(default=1.0, ge=0, le=1e6)
    """Specular part of the echo at normal incidence, relative to the diffuse part."""
    specular_exponent: float = Field(default=24.0, ge=1e-6, le=1e4)
    tvg_exponent: float = Field(default=4.0, ge=-10, le=10)
    """Exponent of range in the time-varying gain; 4 compensates the two-way spherical spreading."""
    absorption_db_per_m: float = Field(default=0.0, ge=0, le=100)
    """One-way absorption that the time-varying gain does not compensate."""
    noise_range_exponent: float = Field(default=0.0, ge=-10, le=10)
    """Growth of the noise scale with range: (range / range_max) ** exponent."""
    near_sigma: float = Field(default=0.0, ge=0, le=100)
    """Rayleigh scale of the volume reverberation at range_min on the axis, added in power to the noise."""
    near_exponent: float = Field(default=1.0, ge=0, le=10)
    """Decrease of reverberation with range: (range_min / range) ** exponent."""
    threshold: float = Field(default=0.0, ge=0, lt=1)
    """Image value that the sonar subtracts from every pixel, clipping at 0."""
    independent_beams: bool = False
    """Noise and speckle are independent between beams, as behind an acoustic lens or in HoloOcean; otherwise they are
    correlated between beams whose lobes overlap."""
    multi_path_db: float = Field(default=-14.0, ge=-300, le=0)
    """Power of a second-bounce echo after two specular reflections, relative to a direct one."""
    gain: float | None = Field(default=None, ge=1e-12, le=1e12)
    """Image units per square root of echo density; by default chosen from the scene."""

    @model_validator(mode="after")
    def _check(self) -> "ImagingSonar":
        span_m = self.range_max - self.range_min
        if span_m < MIN_SPAN_M:
            raise ValueError(f"RangeMin {self.range_min} must be below RangeMax {self.range_max}")
        if self.pulse_length_m is not None and self.pulse_length_m > span_m:
            raise ValueError(f"pulse_length_m {self.pulse_length_m} must be within the {span_m:g} m of range")
        for name, bins in (("RangeBins", self.range_bins), ("ElevationBins", self.elevation_bins)):
            if self.azimuth_bins * bins > MAX_CELLS:
                raise ValueError(f"AzimuthBins {self.azimuth_bins} x {name} {bins} is more than {MAX_CELLS}")
        if self.bearings_deg is not None:
            if len(self.bearings_deg) != self.azimuth_bins:
                raise ValueError(f"bearings_deg has {len(self.bearings_deg)} beams, AzimuthBins is {self.azimuth_bins}")
            if np.any(np.diff(self.bearings_deg) <= 0):
                raise ValueError("bearings_deg must rise from starboard to port")
        return self


def _check_kinds(settings: dict[str, Any], where: str) -> None:
    """Refuse text and booleans where a number is expected; pydantic would convert them."""
    for key, value in settings.items():
        if isinstance(value, str) and key not in TEXT_KEYS:
            raise AsfmError(f"{where}: sonar parameter {quote(key)}: expected a number, found {quote(value)}")
        if isinstance(value, bool) and key not in SWITCH_KEYS:
            raise AsfmError(f"{where}: sonar parameter {quote(key)}: expected a number, found {str(value).lower()}")


def parse_sonar(settings: dict[str, Any], where: str) -> ImagingSonar:
    """Validate settings under HoloOcean's names or those of :class:`ImagingSonar`.

    Args:
        settings: parameters by name.
        where: beginning of error messages, such as the file.

    Raises:
        AsfmError: a key is unknown or a value invalid.
    """
    known_names = {name for field in ImagingSonar.model_fields for name in (field, _holoocean_name(field))}
    _check_kinds({key: value for key, value in settings.items() if key in known_names}, where)
    try:
        return ImagingSonar.model_validate(settings)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        if first["type"] == "extra_forbidden":
            known = ", ".join(_holoocean_name(field) for field in ImagingSonar.model_fields)
            raise AsfmError(f"{where}: unknown sonar parameter {quote(key)}; known: {known}") from None
        message = first["msg"].removeprefix("Value error, ")
        if key:
            expected = message.replace("Input should be", "expected")
            message = f"sonar parameter {quote(key)}: {expected}, found {quote(first['input'])}"
        raise AsfmError(f"{where}: {message}") from None


def make_sonar_model(sonar: ImagingSonar) -> SonarModel:
    """Return the pixel grid of a simulated sonar."""
    aperture_rad = np.deg2rad(sonar.elevation)
    range_m = (sonar.range_min, sonar.range_max)
    if sonar.bearings_deg is None:
        half_rad = np.deg2rad(sonar.azimuth) / 2
        shape = (sonar.range_bins, sonar.azimuth_bins)
        return SonarModel.evenly_spaced(sonar.name, range_m, (-half_rad, half_rad), shape, aperture_rad)
    edges_m: FloatArray = np.linspace(*range_m, sonar.range_bins + 1)
    centres_m = 0.5 * (edges_m[1:] + edges_m[:-1])
    return SonarModel(sonar.name, centres_m, np.deg2rad(np.array(sonar.bearings_deg)), aperture_rad)
