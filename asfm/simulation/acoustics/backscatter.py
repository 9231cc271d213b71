"""Backscatter model: echo strength by Lambert's law with a specular lobe, spreading, absorption and beam pattern.

For a ray of solid angle W that hits a face of reflectivity m at range r and incidence angle i, the backscattered
power after two-way spreading is m (cos i + s exp(n (cos i - 1))) W / r^2: Lambert's m cos^2 i over the area W r^2 /
cos i, plus a specular lobe, which approximates the Phong lobe s cos^n i.
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
GRAIN_COUNT = 65536
HASH_PRIMES = (np.int32(73856093), np.int32(19349663), np.int32(83492791))
"""Primes of a spatial hash, which gives neighbouring grains different factors."""


@dataclass(frozen=True)
class EchoStrength:
    """Parameters of the echo strength that do not depend on the hit: scene, beam pattern and time-varying gain."""

    reflectivity: ImageArray
    """(F + 1,) of every face; the last is 0, for rays without a hit (face -1)."""
    grain: ImageArray
    """(GRAIN_COUNT,) reflectivity factors, chosen by the hash of a grain's position; (1,) for a scene without grain."""
    ray_gain: ImageArray
    """(N,) beam pattern times share of a pixel's solid angle of each ray."""
    rows_per_slope: ImageArray
    """(N,) minus elevation step / (range step cos(elevation)), which turns the slope of a face into rows per ray."""
    specular_strength: np.float32
    specular_exponent: np.float32
    mid_range_m: np.float32
    """Middle of the range interval, at which the range gain is normalised."""
    excess_gain_exponent: np.float32
    """Exponent of range in the time-varying gain, beyond the one that compensates the spreading."""
    absorption_bel_per_m: np.float32
    """Two-way absorption that the gain does not compensate; negative."""

    def part(self, rays: slice) -> "EchoStrength":
        """Return the parameters of some of the rays."""
        return replace(self, ray_gain=self.ray_gain[rays], rows_per_slope=self.rows_per_slope[rays])


def make_echo_strength(scene: Scene, fan: RayFan, sonar: ImagingSonar, model: SonarModel) -> EchoStrength:
    """Compute the parameters of the echo strength, once for all pings."""
    return EchoStrength(
        np.append(scene.reflectivity, 0.0).astype(np.float32),
        _draw_grain_factors(scene.grain),
        _ray_gain(fan, sonar, model),
        (-fan.elevation_step_rad / model.range_step_m / np.cos(fan.elevation_rad)).astype(np.float32),
        np.float32(sonar.specular_strength),
        np.float32(sonar.specular_exponent),
        np.float32(0.5 * (sonar.range_min + sonar.range_max)),
        np.float32(sonar.tvg_exponent - 4.0),
        np.float32(-0.2 * sonar.absorption_db_per_m),
    )


def _draw_grain_factors(grain: float) -> ImageArray:
    """Draw log-normal factors of mean 1 with the given sigma of the logarithm; always the same ones."""
    if not grain:
        return np.ones(1, dtype=np.float32)
    rng = np.random.default_rng(GRAIN_COUNT)
    draws = rng.standard_normal(GRAIN_COUNT)
    return np.exp(grain * draws - 0.5 * grain**2).astype(np.float32)


def _ray_gain(fan: RayFan, sonar: ImagingSonar, model: SonarModel) -> ImageArray:
    """Return the two-way beam pattern times each ray's share of a pixel's solid angle, (N,)."""
    off_axis = fan.elevation_rad / (model.elevation_aperture_rad / 2)
    bearing = model.bearing_rad / np.abs(model.bearing_rad).max()
    pattern_db = sonar.elevation_edge_db * off_axis**2 + (sonar.azimuth_edge_db * bearing**2)[fan.column]
    pixel = model.range_step_m * np.diff(model.bearing_edges_rad)[fan.column]
    return np.asarray(10 ** (pattern_db / 10) * fan.solid_angle_sr / pixel, dtype=np.float32)


def compute_echo_power(hits: Hits, cos_incidence: ImageArray, strength: EchoStrength) -> ImageArray:
    """Compute the power of each ray's echo.

    Args:
        hits: N rays.
        cos_incidence: (N,) absolute cosine between ray and normal.
        strength: parameters of the scene and the sonar.

    Returns:
        (N,) share of a pixel's echo density; 0 where nothing was hit.
    """
    power = cos_incidence - np.float32(1)
    power *= strength.specular_exponent
    np.exp(power, out=power)
    power *= strength.specular_strength
    power += cos_incidence
    power *= strength.reflectivity.take(hits.face, mode="wrap")
    if len(strength.grain) > 1:
        power *= strength.grain.take(_grain_index(hits))
    power *= strength.ray_gain
    power *= _range_gain(hits.range_m, strength)
    return power


def _range_gain(range_m: ImageArray, strength: EchoStrength) -> ImageArray:
    """Return the factor of range, (N,): area covered, spreading, absorption and time-varying gain."""
    gain = range_m * range_m * (1 / strength.mid_range_m)
    if strength.excess_gain_exponent:
        gain *= (range_m * (1 / strength.mid_range_m)) ** strength.excess_gain_exponent
    if strength.absorption_bel_per_m:
        gain *= np.float32(10.0) ** (range_m * strength.absorption_bel_per_m)
    return gain


def _grain_index(hits: Hits) -> NDArray[np.int32]:
    """Hash the grid cell (GRAIN_M wide, fixed to the world) in which each ray ends to 0..GRAIN_COUNT - 1, (N,)."""
    index = np.zeros(len(hits.range_m), dtype=np.int32)
    for axis, factor in enumerate(HASH_PRIMES):
        position = hits.direction[axis] * hits.range_m
        position += hits.origin_m[axis]
        position *= np.float32(1 / GRAIN_M)
        position += np.float32(1 << 14)  # makes all values positive, so that truncation rounds down
        cell = position.astype(np.int32)
        cell *= factor
        index ^= cell
    index ^= index >> 15
    index &= GRAIN_COUNT - 1
    return index
