"""View change between two frames: rotation about the vertical and distance moved, in fixed bins."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from asfm.types import FloatArray

ROTATION_EDGES_DEG = (0, 1, 2, 5, 10, 20, 45)
"""Lower edges of the bins of rotation; the last one is open."""
DISTANCE_EDGES_CM = (0, 2, 5, 10, 20, 50, 100, 200)
"""Lower edges of the bins of distance; the last one is open."""


@dataclass(frozen=True)
class ViewChange:
    """Motion of the sonar from one frame to another."""

    rotation_deg: float
    """Angle of the rotation about the vertical, zero or more."""
    distance_m: float


@dataclass(frozen=True)
class Bin:
    """One bin of view changes."""

    key: str
    """Part of a row's key, as ``rotation_2_to_5_deg``."""
    name: str
    """For readers, as "rotation about the vertical of 2 to 5 degrees"."""


def measure_view_change(world_from_a: FloatArray, world_from_b: FloatArray) -> ViewChange:
    """Measure the motion between two (4, 4) poses of the sonar.

    The rotation about the vertical is the twist of the rotation in the world about the world's z axis (swing-twist
    decomposition, Dobrowolski 2015), which roll and pitch do not change to first order.
    """
    turn = world_from_b[:3, :3] @ world_from_a[:3, :3].T
    twist_rad = np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
    distance_m = np.linalg.norm(world_from_b[:3, 3] - world_from_a[:3, 3])
    return ViewChange(abs(float(np.degrees(twist_rad))), float(distance_m))


def rotation_bins() -> tuple[Bin, ...]:
    """Return the bins of rotation about the vertical, in rising order."""
    return tuple(
        Bin(f"rotation_{key}_deg", f"rotation about the vertical of {name} degrees")
        for key, name in _name_intervals(ROTATION_EDGES_DEG)
    )


def distance_bins() -> tuple[Bin, ...]:
    """Return the bins of distance moved, in rising order."""
    return tuple(
        Bin(f"distance_{key}_cm", f"distance of {name} cm") for key, name in _name_intervals(DISTANCE_EDGES_CM)
    )


def find_rotation_bin(change: ViewChange) -> Bin:
    """Return the bin of rotation that a view change lies in; a bin holds its lower edge."""
    return rotation_bins()[_find_interval(change.rotation_deg, ROTATION_EDGES_DEG)]


def find_distance_bin(change: ViewChange) -> Bin:
    """Return the bin of distance that a view change lies in; a bin holds its lower edge."""
    return distance_bins()[_find_interval(100 * change.distance_m, DISTANCE_EDGES_CM)]


def _find_interval(value: float, edges: tuple[int, ...]) -> int:
    return int(np.searchsorted(edges, value, side="right")) - 1


def _name_intervals(edges: tuple[int, ...]) -> list[tuple[str, str]]:
    """Return the key and the name of each interval."""
    closed = [(f"{low}_to_{high}", f"{low} to {high}") for low, high in pairwise(edges)]
    return [*closed, (f"{edges[-1]}_and_more", f"{edges[-1]} and more")]
