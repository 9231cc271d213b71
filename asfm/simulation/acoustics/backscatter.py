"""The strength of every ray's echo.

For a ray of solid angle W that meets a face of reflectivity m at range r and incidence angle i, the backscattered
power after two-way spreading is m (cos i + s exp(n (cos i - 1))) W / r^2: Lambert's m cos^2 i over the area W r^2 /
cos i, plus a mirror-like lobe, which is close to the usual s cos^n i.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from asfm.geometry.sonar import SonarModel
from asfm.simulation.acoustics.rays import Hits, RayFan
from asfm.simulation.scenes.scene import Scene
from asfm.simulation.sonars.parameters import ImagingSonar
from asfm.types import ImageArray

GRAIN_M = 0.02
HASH = (np.int32(73856093), np.int32(19349663), np.int32(83492791))
"""Primes that scatter neighbouring grains."""


@dataclass(frozen=True)
class EchoStrength:
    """What the strength of an echo depends on besides the hit itself."""

    reflectivity: ImageArray
    """(F + 1,) of every face, and at the end the 0 of a ray that struck none (face -1)."""
    grain: ImageArray
    """(65536,) factors of the grains, dealt out by the hash of a grain's place; (1,) where a scene has no grain."""
    ray_gain: ImageArray
    """(N,) beam pattern and share of a pixel's solid angle of each ray."""
    rows_per_slope: ImageArray
    """(N,) elevation step of each ray in rows a metre, over the cosine of its elevation; negative."""
    specular_strength: np.float32
    specular_exponent: np.float32
    middle_m: np.float32
    """Mid-range, at which a solid angle of 1 sr is given the weight of 1 m."""
    excess_gain_exponent: np.float32
    """What the time-varying gain does beyond undoing the spreading, in powers of range."""
    absorption_bel_per_m: np.float32
    """Two-way, not undone by the gain; negative."""

    def part(self, rays: slice) -> "EchoStrength":
        """Give what the strength of some rays' echoes depends on."""
        return replace(self, ray_gain=self.ray_gain[rays], rows_per_slope=self.rows_per_slope[rays])


def weigh_echoes(scene: Scene, fan: RayFan, sonar: ImagingSonar, model: SonarModel) -> EchoStrength:
    """Work out once what the strength of echoes depends on besides the hit."""
    return EchoStrength(
        np.append(scene.reflectivity, 0.0).astype(np.float32),
        _deal_grains(scene.grain),
        _ray_gain(fan, sonar, model),
        (-fan.elevation_step_rad / model.range_step_m / np.cos(fan.elevation_rad)).astype(np.float32),
        np.float32(sonar.specular_strength),
        np.float32(sonar.specular_exponent),
        np.float32(0.5 * (sonar.range_min + sonar.range_max)),
        np.float32(sonar.tvg_exponent - 4.0),
        np.float32(-0.2 * sonar.absorption_db_per_m),
    )


def _deal_grains(grain: float) -> ImageArray:
    """Draw the grains' factors, of mean 1; always the same ones."""
    if not grain:
        return np.ones(1, dtype=np.float32)
    rng = np.random.default_rng(65536)
    draws = rng.standard_normal(65536)
    return np.exp(grain * draws - 0.5 * grain**2).astype(np.float32)


def _ray_gain(fan: RayFan, sonar: ImagingSonar, model: SonarModel) -> ImageArray:
    """Transmitter's and receiver's beam pattern times the ray's share of a pixel's solid angle."""
    off_axis = fan.elevation_rad / (model.elevation_aperture_rad / 2)
    bearing = model.bearing_rad / np.abs(model.bearing_rad).max()
    pattern_db = sonar.elevation_edge_db * off_axis**2 + (sonar.azimuth_edge_db * bearing**2)[fan.column]
    pixel = model.range_step_m * np.diff(model.bearing_edges_rad)[fan.column]
    return np.asarray(10 ** (pattern_db / 10) * fan.solid_angle_sr / pixel, dtype=np.float32)


def measure_strength(hits: Hits, facing: ImageArray, strength: EchoStrength) -> ImageArray:
    """Give each ray's share of a pixel's echo density, from the cosines of incidence and what was struck."""
    power = facing - np.float32(1)
    power *= strength.specular_exponent
    np.exp(power, out=power)
    power *= strength.specular_strength
    power += facing
    power *= strength.reflectivity.take(hits.face, mode="wrap")
    if len(strength.grain) > 1:
        power *= strength.grain.take(_grain_number(hits))
    power *= strength.ray_gain
    power *= _range_gain(hits.range_m, strength)
    return power


def _range_gain(range_m: ImageArray, strength: EchoStrength) -> ImageArray:
    """Spreading, absorption and time-varying gain, over the area that a solid angle covers; 1 m at mid-range."""
    gain = range_m * range_m * (1 / strength.middle_m)
    if strength.excess_gain_exponent:
        gain *= (range_m * (1 / strength.middle_m)) ** strength.excess_gain_exponent
    if strength.absorption_bel_per_m:
        gain *= np.float32(10.0) ** (range_m * strength.absorption_bel_per_m)
    return gain


def _grain_number(hits: Hits) -> NDArray[np.int32]:
    """Hash the cube of space in which each ray ends to 0..65535."""
    number = np.zeros(len(hits.range_m), dtype=np.int32)
    for axis, factor in enumerate(HASH):
        place = hits.ahead[axis] * hits.range_m
        place += hits.origin_m[axis]
        place *= np.float32(1 / GRAIN_M)
        place += np.float32(1 << 14)  # makes all numbers positive, so that cutting off the fraction is rounding down
        cell = place.astype(np.int32)
        cell *= factor
        number ^= cell
    number ^= number >> 15
    number &= 0xFFFF
    return number
