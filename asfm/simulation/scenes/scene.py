"""Scene: a triangle mesh with a reflectivity per face."""

from dataclasses import dataclass

import numpy as np

from asfm.types import FloatArray, IntArray


@dataclass(frozen=True)
class Scene:
    """A triangle mesh in world coordinates (z up) with its reflectivity."""

    name: str
    vertices_m: FloatArray
    """(V, 3) vertices."""
    faces: IntArray
    """(F, 3) vertex indices of each triangle, counter-clockwise seen from outside."""
    reflectivity: FloatArray
    """(F,) diffuse reflectivity of each face; 1 is a bright rock."""
    grain: float = 0.0
    """Standard deviation of the logarithm of a finer reflectivity, in cells of 2 cm fixed to the world."""
    winds_outward: bool = True
    """False for an open mesh, whose winding does not define inside and outside."""


def join_scenes(name: str, parts: list[Scene]) -> Scene:
    """Concatenate the faces of several scenes."""
    offsets = np.cumsum([0, *(len(part.vertices_m) for part in parts)])
    return Scene(
        name,
        np.concatenate([part.vertices_m for part in parts]),
        np.concatenate([part.faces + offset for part, offset in zip(parts, offsets[:-1], strict=True)]),
        np.concatenate([part.reflectivity for part in parts]),
        max(part.grain for part in parts),
        all(part.winds_outward for part in parts),
    )
