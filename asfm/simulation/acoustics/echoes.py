"""The echoes of a ping: which row each ray is heard in, how strongly, and over how many rows.

Elevation ambiguity, shadow and layover follow from the geometry alone.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.geometry.sonar import SonarModel
from asfm.simulation.acoustics.backscatter import EchoStrength, measure_strength
from asfm.simulation.acoustics.rays import Hits, RayFan, measure_incidence
from asfm.types import ImageArray, IntArray

MAX_PARTS = 12
"""Rows over which the footprint of one ray may spread at most."""
PLACES = np.concatenate([(np.arange(n) + 0.5) / n - 0.5 for n in range(1, MAX_PARTS + 1)]).astype(np.float32)
"""Middles of the parts of 1, of 2, ... of MAX_PARTS."""
PLACES_BEFORE = np.array([n * (n - 1) // 2 for n in range(MAX_PARTS + 1)])
"""Number of places before those of n parts."""
STEEPEST = np.float32(1e-3)
"""Cosine of incidence below which a face counts as seen edge-on."""


@dataclass(frozen=True)
class Echoes:
    """Pieces of surface as the receiver hears them, before its own spread; E of them."""

    row: ImageArray
    """(E,) fractional row."""
    power: ImageArray
    """(E,) share of the pixel's echo density."""
    fan: RayFan
    """The N rays, whose echoes come first."""
    part_ray: IntArray
    """(E - N,) ray of each part of a long footprint; the parts follow after the rays."""
    part_place: ImageArray
    """(E - N,) where in its footprint the part lies, -0.5..0.5."""

    @property
    def column(self) -> IntArray:
        """(E,) beam."""
        return _append(self.fan.column, self.part_ray)

    @property
    def elevation_rad(self) -> ImageArray:
        """(E,) elevations in radians."""
        elevation_rad = _append(self.fan.elevation_rad, self.part_ray)
        elevation_rad[len(self.fan.column) :] += self.part_place * np.float32(self.fan.elevation_step_rad)
        return elevation_rad


def trace_echoes(hits: Hits, fan: RayFan, strength: EchoStrength, model: SonarModel) -> Echoes:
    """Turn hits into echoes; what was not struck stays, without power, beyond the last row."""
    toward, upward = measure_incidence(hits)
    facing = np.abs(toward)
    # On the tangent plane n.p = const, so that dr/d(elevation) = -r (n.d') / (n.d), where d' = d direction/d(elevation)
    # = (z - sin(elevation) d) / cos(elevation) with the sonar's upward axis z.
    extent = upward
    extent -= fan.direction[2] * toward
    extent *= hits.range_m
    extent *= strength.rows_per_slope
    np.copyto(toward, STEEPEST, where=facing < STEEPEST)
    extent /= toward
    row = hits.range_m - np.float32(model.range_edges_m[0])
    row *= np.float32(1 / model.range_step_m)
    power = measure_strength(hits, facing, strength)
    return _split(row, power, extent, fan)


def delay_echoes(echoes: Echoes, delay_rows: float, rng: np.random.Generator) -> Echoes:
    """Delay each echo by an exponential variate of the stated mean."""
    late = rng.standard_exponential(len(echoes.row), dtype=np.float32) * np.float32(delay_rows)
    return replace(echoes, row=echoes.row + late)


def _split(row: ImageArray, power: ImageArray, extent: ImageArray, fan: RayFan) -> Echoes:
    """Split echoes of faces so oblique that one ray's footprint covers several rows; ``power`` is overwritten."""
    wide = np.flatnonzero(np.abs(extent) > 1)
    if not len(wide):
        return Echoes(row, power, fan, wide, np.empty(0, dtype=np.float32))
    reach = extent.take(wide)
    np.clip(reach, -MAX_PARTS, MAX_PARTS, out=reach)
    parts = np.ceil(np.abs(reach)).astype(np.intp)
    ray, place = np.repeat(wide, parts), _place_parts(parts)
    power[wide] /= parts
    row, power = _append(row, ray), _append(power, ray)
    row[len(extent) :] += np.repeat(reach, parts) * place
    power[wide] = 0  # the whole gives way to its parts
    return Echoes(row, power, fan, ray, place)


def _place_parts(parts: IntArray) -> ImageArray:
    """Give where the middle of every part lies, in -0.5..0.5 of its whole; one whole's parts after another's."""
    last = np.cumsum(parts)
    number = np.arange(last[-1])
    number += np.repeat(PLACES_BEFORE.take(parts) - last + parts, parts)
    return PLACES.take(number)


def _append(values: NDArray[Any], index: IntArray) -> NDArray[Any]:
    """Append some of the values, chosen by index, to all of them."""
    longer = np.empty(len(values) + len(index), dtype=values.dtype)
    longer[: len(values)] = values
    values.take(index, out=longer[len(values) :], mode="clip")  # the default mode would make a copy
    return longer
