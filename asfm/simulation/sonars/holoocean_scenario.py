"""Simulated sonar from a HoloOcean scenario: its ImagingSonar converted to the simulator's parameters.

Names, units and defaults are those of HoloOcean's ImagingSonar (its documentation of the sensor, and how its engine
uses the numbers). Its image is echo x (0.5 + N(0, MultSigma)) + Rayleigh(AddSigma), so that the contrast of the speckle
is twice MultSigma; ScaleNoise lets AddSigma grow with the square of range.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from asfm.datasets.holoocean.scenario_sensors import check_number, read_sensors
from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError, quote, shorten
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
"""Parameters of HoloOcean's octree and drawing, which ray casting does not need."""

HOLOOCEAN_DEFAULTS = {"AddSigma": 0.0, "MultSigma": 0.0, "independent_beams": True}
"""HoloOcean's defaults where they differ from those of :class:`ImagingSonar`."""

DEFAULT_NAME = "HoloOcean ImagingSonar"
CONTRAST_PER_MULT_SIGMA = 2.0
SCALED_NOISE_EXPONENT = 2.0


@dataclass(frozen=True)
class MountedSonar:
    """A sonar to simulate, and how it is mounted on the vehicle."""

    sonar: ImagingSonar
    vehicle_from_sonar: FloatArray
    """(4, 4)"""
    diagnostics: tuple[Diagnostic, ...] = ()
    """Settings of a scenario that are not simulated."""


def read_mounted_sonar(path: Path) -> MountedSonar:
    """Read the imaging sonar of a scenario: the main agent's first, by default the first of any agent.

    Raises:
        AsfmError: no JSON, no imaging sonar, or a key or value of its configuration that is not HoloOcean's.
    """
    sonars = read_sensors(path).sonars
    sensor, diagnostics = sonars[0], list[Diagnostic]()
    if len(sonars) > 1:
        message = f"{path} has {len(sonars)} imaging sonars: the first is simulated"
        diagnostics.append(Diagnostic("multiple-sonars", message))
    settings = {key: value for key, value in sensor.configuration.items() if key not in ENGINE_KEYS}
    if settings.pop("AzimuthStreaks", 0):
        diagnostics.append(Diagnostic("unsupported-setting", f"AzimuthStreaks of {path} is not simulated"))
    _convert_resolutions(path, settings)
    _convert_noise(path, settings)
    settings = HOLOOCEAN_DEFAULTS | settings
    if sensor.rate_hz is not None:
        settings["rate_hz"] = sensor.rate_hz
    if "name" not in settings:
        settings["name"] = shorten(str(sensor.settings.get("sensor_name") or DEFAULT_NAME)[:200])
    return MountedSonar(parse_sonar(settings, str(path)), sensor.vehicle_from_sensor, tuple(diagnostics))


def _convert_resolutions(path: Path, settings: dict[str, Any]) -> None:
    """Replace RangeRes and AzimuthRes, in place, by RangeBins and AzimuthBins: as many whole bins as fit."""
    default = ImagingSonar()
    stated = {"RangeMin": default.range_min, "RangeMax": default.range_max, "Azimuth": default.azimuth} | settings
    for name, high, low in (("Range", "RangeMax", "RangeMin"), ("Azimuth", "Azimuth", None)):
        if f"{name}Res" not in settings:
            continue
        _refuse_both(path, settings, f"{name}Bins", f"{name}Res")
        step = check_number(settings.pop(f"{name}Res"), f"{path}: {name}Res", positive=True)
        lowest = check_number(stated[low], f"{path}: {low}") if low else 0.0
        span = check_number(stated[high], f"{path}: {high}") - lowest
        settings[f"{name}Bins"] = int(np.clip(span / step + 1e-6, 0, MAX_CELLS))


def _convert_noise(path: Path, settings: dict[str, Any]) -> None:
    """Replace, in place, variances by standard deviations and HoloOcean's noise parameters by the simulator's."""
    for name in ("Add", "Mult"):
        if f"{name}Cov" in settings:
            _refuse_both(path, settings, f"{name}Sigma", f"{name}Cov")
            settings[f"{name}Sigma"] = check_number(settings.pop(f"{name}Cov"), f"{path}: {name}Cov") ** 0.5
    if "MultSigma" in settings:
        sigma = check_number(settings["MultSigma"], f"{path}: MultSigma")
        if sigma > 1 / CONTRAST_PER_MULT_SIGMA:
            raise AsfmError(
                f"{path}: MultSigma: expected 0.5 at most, where speckle is as strong as echoes, found {sigma:g}"
            )
        settings["MultSigma"] = CONTRAST_PER_MULT_SIGMA * sigma
    for switch in ("ScaleNoise", "MultiPath"):
        if switch in settings and settings[switch] not in (0, 1):  # also False and True
            raise AsfmError(f"{path}: {switch}: expected true or false, found {quote(settings[switch])}")
    if settings.pop("ScaleNoise", False):
        settings.setdefault("noise_range_exponent", SCALED_NOISE_EXPONENT)


def _refuse_both(path: Path, settings: dict[str, Any], one: str, other: str) -> None:
    if one in settings:
        raise AsfmError(f"{path}: expected {one} or {other}, found both")
