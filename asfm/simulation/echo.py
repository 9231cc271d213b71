"""The echo of every ray, and the sum of echoes in every pixel: power before the receiver's spread and noise.

For a ray of solid angle W that meets a face of reflectivity m at range r and incidence angle i, the backscattered
power after two-way spreading is m (cos i + s exp(n (cos i - 1))) W / r^2: Lambert's m cos^2 i over the area W r^2 /
cos i, plus a mirror-like lobe, which is close to the usual s cos^n i. Elevation ambiguity, shadow and layover follow
from the geometry alone.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from asfm.simulation.rays import Hits, RayFan
from asfm.simulation.scene import Scene
from asfm.simulation.sensor import ImagingSonar
from asfm.sonar import SonarModel
from asfm.types import FloatArray, ImageArray, IntArray

MAX_PARTS = 12
"""Rows over which the footprint of one ray may spread at most."""
STEEPEST = np.float32(1e-3)
"""Cosine of incidence below which a face counts as seen edge-on."""
GRAIN_M = 0.02
SAME_SURFACE_RAD = np.deg2rad(1.0)


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


@dataclass(frozen=True)
class Echoes:
    """Pieces of surface as the receiver hears them, before its own spread; E of them."""

    row: ImageArray
    """(E,) fractional row."""
    column: IntArray
    """(E,) beam."""
    power: ImageArray
    """(E,) share of the pixel's echo density."""
    elevation_rad: ImageArray
    """(E,)"""


def trace_echoes(hits: Hits, fan: RayFan, strength: EchoStrength, model: SonarModel) -> Echoes:
    """Turn hits into echoes; what was not struck stays, without power, beyond the last row."""
    facing = np.abs(hits.toward)
    power = facing + strength.specular_strength * np.exp(strength.specular_exponent * (facing - 1))
    power *= strength.reflectivity.take(hits.face, mode="wrap")
    if len(strength.grain) > 1:
        power *= strength.grain.take(_grain_number(hits.place_m))
    power *= strength.ray_gain
    power *= _range_gain(hits.range_m, strength)
    # On the tangent plane n.p = const, so that dr/d(elevation) = -r (n.d') / (n.d), where d' = d direction/d(elevation)
    # = (z - sin(elevation) d) / cos(elevation) with the sonar's upward axis z.
    extent = hits.upward - fan.direction[2] * hits.toward
    extent *= hits.range_m
    extent *= strength.rows_per_slope
    extent /= np.where(facing < STEEPEST, STEEPEST, hits.toward)
    row = (hits.range_m - np.float32(model.range_edges_m[0])) * np.float32(1 / model.range_step_m)
    return _split(Echoes(row, fan.column, power, fan.elevation_rad), extent, fan.elevation_step_rad)


def delay_echoes(echoes: Echoes, delay_rows: float, rng: np.random.Generator) -> Echoes:
    """Delay each echo by an exponential variate of the stated mean."""
    late = rng.standard_exponential(len(echoes.row), dtype=np.float32) * np.float32(delay_rows)
    return replace(echoes, row=echoes.row + late)


def _grain_number(place_m: ImageArray) -> NDArray[np.int32]:
    """Hash the cube of space that each (3, N) place lies in to 0..65535."""
    # The shift makes all numbers positive, so that cutting off the fraction is rounding down.
    x, y, z = (place_m * np.float32(1 / GRAIN_M) + np.float32(1 << 14)).astype(np.int32)
    number: NDArray[np.int32] = x * np.int32(73856093) ^ y * np.int32(19349663) ^ z * np.int32(83492791)
    number ^= number >> 15
    number &= 0xFFFF
    return number


def _deal_grains(grain: float) -> ImageArray:
    """Draw the grains' factors, of mean 1; always the same ones."""
    if not grain:
        return np.ones(1, dtype=np.float32)
    rng = np.random.default_rng(65536)
    draws = rng.standard_normal(65536)
    return np.exp(grain * draws - 0.5 * grain**2).astype(np.float32)


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


def _ray_gain(fan: RayFan, sonar: ImagingSonar, model: SonarModel) -> ImageArray:
    """Transmitter's and receiver's beam pattern times the ray's share of a pixel's solid angle."""
    off_axis = fan.elevation_rad / (model.elevation_aperture_rad / 2)
    bearing = model.bearing_rad / np.abs(model.bearing_rad).max()
    pattern_db = sonar.elevation_edge_db * off_axis**2 + (sonar.azimuth_edge_db * bearing**2)[fan.column]
    pixel = model.range_step_m * np.diff(model.bearing_edges_rad)[fan.column]
    return np.asarray(10 ** (pattern_db / 10) * fan.solid_angle_sr / pixel, dtype=np.float32)


def _range_gain(range_m: ImageArray, strength: EchoStrength) -> ImageArray:
    """Spreading, absorption and time-varying gain, over the area that a solid angle covers; 1 m at mid-range."""
    gain = range_m * range_m * (1 / strength.middle_m)
    if strength.excess_gain_exponent:
        gain *= (range_m * (1 / strength.middle_m)) ** strength.excess_gain_exponent
    if strength.absorption_bel_per_m:
        gain *= np.float32(10.0) ** (range_m * strength.absorption_bel_per_m)
    return gain


def _split(echoes: Echoes, extent: ImageArray, step_rad: float) -> Echoes:
    """Split echoes of faces so oblique that one ray's footprint covers several rows."""
    extent = np.clip(extent, -MAX_PARTS, MAX_PARTS)
    wide = np.flatnonzero(np.abs(extent) > 1)
    if not len(wide):
        return echoes
    parts = np.ceil(np.abs(extent[wide])).astype(np.int64)
    index = np.repeat(wide, parts)
    count = np.repeat(parts, parts).astype(np.float32)
    part = np.arange(len(index)) - np.repeat(np.cumsum(parts) - parts, parts)
    place = (part + np.float32(0.5)) / count - np.float32(0.5)
    power = echoes.power.copy()
    power[wide] = 0  # the whole gives way to its parts
    return Echoes(
        np.concatenate([echoes.row, echoes.row[index] + place * extent[index]]),
        np.concatenate([echoes.column, echoes.column[index]]),
        np.concatenate([power, echoes.power[index] / count]),
        np.concatenate([echoes.elevation_rad, echoes.elevation_rad[index] + place * np.float32(step_rad)]),
    )


def accumulate_power(echoes: Echoes, shape: tuple[int, int]) -> ImageArray:
    """Sum echoes into a (ranges, beams) image, each shared by the two rows nearest to it."""
    rows, columns = shape
    position = np.clip(echoes.row + np.float32(0.5), 0, rows + 1)
    upper = position.astype(np.int64)
    share = (position - upper) * echoes.power
    upper *= columns
    upper += echoes.column
    size = (rows + 2) * columns  # a row of padding on either side takes what lies outside
    near = np.bincount(upper, echoes.power - share, size)
    far = np.bincount(upper, share, size)
    return np.asarray(near[columns:-columns] + far[: -2 * columns], dtype=np.float32).reshape(shape)


def average_elevation(echoes: Echoes, shape: tuple[int, int]) -> FloatArray:
    """Give the elevation of each pixel's strongest surface, NaN where nothing echoes.

    Where several surfaces fall into one pixel (layover) a mean over all would name a place where there is nothing:
    the mean, weighted by power, is over the echoes within one degree of the strongest.
    """
    rows, columns = shape
    position = np.clip(echoes.row + np.float32(0.5), 0, rows + 1)
    upper = position.astype(np.int64)
    flat = upper * columns + echoes.column
    pixel = np.concatenate([flat, flat + columns])
    power = np.concatenate([echoes.power * (1 - position + upper), echoes.power * (position - upper)]).astype(float)
    elevation = np.tile(echoes.elevation_rad.astype(float), 2)
    size = (rows + 3) * columns
    greatest = np.zeros(size)
    np.maximum.at(greatest, pixel, power)
    leading = power == greatest[pixel]
    strongest = np.zeros(size)
    strongest[pixel[leading]] = elevation[leading]
    mean: FloatArray = strongest
    for _ in range(2):  # about the strongest, which may lie at the edge of its surface, then about the mean there
        near = np.abs(elevation - mean[pixel]) <= SAME_SURFACE_RAD
        weight = np.bincount(pixel[near], power[near], size)
        total = np.bincount(pixel[near], (power * elevation)[near], size)
        mean = np.divide(total, weight, out=np.full(size, np.nan), where=weight > 0)
    return mean.reshape(-1, columns)[1 : rows + 1]
