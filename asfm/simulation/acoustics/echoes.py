"""Echoes of a ping: range row, power and footprint of each ray's hit.

Elevation ambiguity, shadows and layover follow from the geometry.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.geometry.sonar import SonarModel
from asfm.simulation.acoustics.backscatter import EchoStrength, compute_echo_power
from asfm.simulation.acoustics.rays import Hits, RayFan, compute_incidence
from asfm.types import ImageArray, IntArray

MAX_PARTS = 12
"""Largest number of rows that the footprint of one ray covers."""
PART_CENTRES = np.concatenate([(np.arange(n) + 0.5) / n - 0.5 for n in range(1, MAX_PARTS + 1)]).astype(np.float32)
"""Centres, in -0.5..0.5, of the parts of footprints of 1, 2, ... MAX_PARTS parts, concatenated."""
FIRST_CENTRE = np.array([n * (n - 1) // 2 for n in range(MAX_PARTS + 1)])
"""(MAX_PARTS + 1,) index in PART_CENTRES of the first part of a footprint of n parts."""
MIN_COS_INCIDENCE = np.float32(1e-3)
"""Smaller cosines of incidence (faces seen edge-on) are replaced by this one."""


@dataclass(frozen=True)
class Echoes:
    """E echoes of surface elements, before the point spread of the receiver."""

    row: ImageArray
    """(E,) fractional row."""
    power: ImageArray
    """(E,) share of the pixel's echo density."""
    fan: RayFan
    """The N rays, whose echoes are the first N."""
    part_ray: IntArray
    """(E - N,) ray of each part of a long footprint."""
    part_offset: ImageArray
    """(E - N,) position of the part in its footprint, -0.5..0.5."""

    @property
    def column(self) -> IntArray:
        """(E,) beams."""
        return _append(self.fan.column, self.part_ray)

    @property
    def elevation_rad(self) -> ImageArray:
        """(E,) elevations in the sonar frame."""
        elevation_rad = _append(self.fan.elevation_rad, self.part_ray)
        elevation_rad[len(self.fan.column) :] += self.part_offset * np.float32(self.fan.elevation_step_rad)
        return elevation_rad


def trace_echoes(hits: Hits, fan: RayFan, strength: EchoStrength, model: SonarModel) -> Echoes:
    """Turn the hits of one ping into echoes; rays without a hit get no power and a row beyond the last one.

    Args:
        hits: first hits of N rays.
        fan: the N rays.
        strength: parameters of the echo strength.
        model: the pixel grid.
    """
    cos_incidence, cos_up = compute_incidence(hits)
    facing = np.abs(cos_incidence)
    # On the tangent plane n.p = const, so that dr/d(elevation) = -r (n.d') / (n.d), where d' = d direction/d(elevation)
    # = (z - sin(elevation) d) / cos(elevation) with the sonar's upward axis z.
    extent = cos_up
    extent -= fan.direction[2] * cos_incidence
    extent *= hits.range_m
    extent *= strength.rows_per_slope
    np.copyto(cos_incidence, MIN_COS_INCIDENCE, where=facing < MIN_COS_INCIDENCE)
    extent /= cos_incidence
    row = hits.range_m - np.float32(model.range_edges_m[0])
    row *= np.float32(1 / model.range_step_m)
    power = compute_echo_power(hits, facing, strength)
    return _split_footprints(row, power, extent, fan)


def delay_echoes(echoes: Echoes, delay_rows: float, rng: np.random.Generator) -> Echoes:
    """Delay each echo by an exponentially distributed number of rows with the given mean."""
    delay = rng.standard_exponential(len(echoes.row), dtype=np.float32) * np.float32(delay_rows)
    return replace(echoes, row=echoes.row + delay)


def _split_footprints(row: ImageArray, power: ImageArray, extent: ImageArray, fan: RayFan) -> Echoes:
    """Split the echoes whose footprint covers several rows (oblique faces) into parts; ``power`` is overwritten.

    Args:
        row: (N,) fractional rows.
        power: (N,)
        extent: (N,) rows that each ray's footprint covers, signed.
        fan: the N rays.
    """
    wide = np.flatnonzero(np.abs(extent) > 1)
    if not len(wide):
        return Echoes(row, power, fan, wide, np.empty(0, dtype=np.float32))
    reach = extent.take(wide)
    np.clip(reach, -MAX_PARTS, MAX_PARTS, out=reach)
    parts = np.ceil(np.abs(reach)).astype(np.intp)
    ray, offset = np.repeat(wide, parts), _part_offsets(parts)
    power[wide] /= parts
    row, power = _append(row, ray), _append(power, ray)
    row[len(extent) :] += np.repeat(reach, parts) * offset
    power[wide] = 0  # replaced by the parts
    return Echoes(row, power, fan, ray, offset)


def _part_offsets(parts: IntArray) -> ImageArray:
    """Return the centre of every part in its footprint, -0.5..0.5, for (W,) numbers of parts, concatenated."""
    last = np.cumsum(parts)
    number = np.arange(last[-1])
    number += np.repeat(FIRST_CENTRE.take(parts) - last + parts, parts)
    return PART_CENTRES.take(number)


def _append(values: NDArray[Any], index: IntArray) -> NDArray[Any]:
    """Return the values followed by those selected by index."""
    joined = np.empty(len(values) + len(index), dtype=values.dtype)
    joined[: len(values)] = values
    values.take(index, out=joined[len(values) :], mode="clip")  # the default mode would make a copy
    return joined
