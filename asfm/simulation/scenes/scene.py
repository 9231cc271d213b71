"""A scene: triangles with the strength of their echo."""

from dataclasses import dataclass

import numpy as np

from asfm.types import FloatArray, IntArray


@dataclass(frozen=True)
class Scene:
    """A mesh in world coordinates (z up) whose faces echo."""

    name: str
    vertices_m: FloatArray
    """(V, 3)"""
    faces: IntArray
    """(F, 3) vertices of each triangle, counter-clockwise seen from outside."""
    reflectivity: FloatArray
    """(F,) diffuse strength of each face's echo; 1 is a bright rock."""
    grain: float = 0.0
    """Standard deviation of the logarithm of a finer reflectivity, in grains of 2 cm fixed to the world."""
    winds_outward: bool = True
    """False where the winding tells nothing about inside and outside (an open mesh of somebody's)."""


def join_scenes(name: str, parts: list[Scene]) -> Scene:
    """Put the faces of several scenes into one."""
    offsets = np.cumsum([0, *(len(part.vertices_m) for part in parts)])
    return Scene(
        name,
        np.concatenate([part.vertices_m for part in parts]),
        np.concatenate([part.faces + offset for part, offset in zip(parts, offsets[:-1], strict=True)]),
        np.concatenate([part.reflectivity for part in parts]),
        max(part.grain for part in parts),
        all(part.winds_outward for part in parts),
    )
