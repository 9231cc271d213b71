"""The scenes that can be asked for by name."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from asfm.errors import AsfmError
from asfm.simulation.motions import View
from asfm.simulation.scene import Scene, join_scenes
from asfm.simulation.shapes import make_ground, make_rock, textured


def make_seafloor(
    rng: np.random.Generator, size_m: tuple[float, float] = (20.0, 20.0), boulders_per_m2: float = 0.7
) -> Scene:
    """Lay a seafloor with boulders of 0.07 to 0.6 m radius, around the origin at a height of about zero."""
    vertices_m, faces = make_ground(size_m, 0.06, rng)
    parts = [textured("ground", vertices_m, faces, 0.3, rng)]
    columns = round(size_m[0] / 0.06) + 1
    for _ in range(round(boulders_per_m2 * size_m[0] * size_m[1])):
        radius_m = float(np.exp(rng.normal(np.log(0.2), 0.5)))
        radius_m = min(max(radius_m, 0.07), 0.6)
        place = rng.uniform(-0.49, 0.49, 2) * size_m
        row, column = np.round((place + np.array(size_m) / 2) / 0.06).astype(int)[::-1]
        ground_m = vertices_m[row * columns + column, 2]
        rock, rock_faces = make_rock(radius_m, rng)
        rock += np.array([*place, ground_m + radius_m * rng.uniform(-0.1, 0.6)])
        parts.append(textured("boulder", rock, rock_faces, float(np.exp(rng.normal(np.log(0.8), 0.3))), rng))
    return join_scenes("seafloor", parts)


def view_seafloor(range_max_m: float) -> View:
    """Look obliquely at the ground, which fills the middle of the image."""
    return View((0.0, 0.0, 0.0), 0.0, float(np.deg2rad(25.0)), 0.6 * range_max_m)


@dataclass(frozen=True)
class Recipe:
    """How to make a scene and how to look at it."""

    make: Callable[[np.random.Generator], Scene]
    view: Callable[[float], View]
    """From the sonar's greatest range."""
    motion: str


SCENES: dict[str, Recipe] = {"seafloor": Recipe(make_seafloor, view_seafloor, "sway")}


def find_scene(name: str) -> Recipe:
    """Give a scene's recipe by name.

    Raises:
        AsfmError: no such scene; the message lists those there are.
    """
    if name not in SCENES:
        raise AsfmError(f"unknown scene {name!r}; known: {', '.join(SCENES)}")
    return SCENES[name]
