"""The scenes that can be asked for by name."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asfm.errors import AsfmError
from asfm.simulation.scenes.hull import make_hull
from asfm.simulation.scenes.mesh_file import read_mesh
from asfm.simulation.scenes.pier import make_pier
from asfm.simulation.scenes.scene import Scene
from asfm.simulation.scenes.seafloor import make_seafloor
from asfm.simulation.scenes.tank import make_tank
from asfm.simulation.scenes.wreck import make_wreck
from asfm.simulation.vehicle.trajectories import View

REACH = 0.6
"""Share of the sonar's greatest range at which a scene's target is looked at."""


@dataclass(frozen=True)
class Recipe:
    """How to make a scene and how to look at it."""

    make: Callable[[np.random.Generator], Scene]
    target_m: tuple[float, float, float]
    heading_deg: float
    depression_deg: float
    motion: str
    room_m: float = np.inf
    """How far from the target a sonar can be without leaving the scene."""

    def build(self, range_max_m: float, rng: np.random.Generator) -> tuple[Scene, View]:
        """Make the scene, and the view in which its target fills the middle of an image of that range."""
        return self.make(rng), self.look(range_max_m)

    def look(self, range_max_m: float) -> View:
        """Give the view in which the target fills the middle of an image of that range."""
        heading_rad, depression_rad = np.deg2rad([self.heading_deg, self.depression_deg])
        distance_m = min(REACH * range_max_m, self.room_m)
        return View(self.target_m, float(heading_rad), float(depression_rad), distance_m)


@dataclass(frozen=True)
class MeshRecipe:
    """How to look at somebody's mesh: from outside, at an angle."""

    path: Path
    motion: str = "orbit"

    def build(self, range_max_m: float, rng: np.random.Generator) -> tuple[Scene, View]:
        """Read the mesh, and look at its middle from a distance that leaves room around it."""
        scene = read_mesh(self.path, rng)
        low, high = scene.vertices_m.min(axis=0), scene.vertices_m.max(axis=0)
        x, y, z = (float(value) for value in 0.5 * (low + high))
        radius_m = float(np.hypot(*(high - low)[:2])) / 2
        distance_m = max(REACH * range_max_m, radius_m + 0.3 * range_max_m)
        return scene, View((x, y, z), 0.0, float(np.deg2rad(20.0)), distance_m)


SCENES: dict[str, Recipe] = {
    # Boulders of 0.07 to 0.6 m radius on gentle swells.
    "seafloor": Recipe(make_seafloor, (0.0, 0.0, 0.0), 0.0, 25.0, "sway"),
    # Two rows of piles with braces before a block wall, debris below.
    "pier": Recipe(make_pier, (0.9, 0.0, 0.7), 0.0, 20.0, "transect"),
    # A ship's bottom from below: anodes, gratings, outlets, bilge keels.
    "hull": Recipe(make_hull, (0.0, 0.0, 0.0), 70.0, -26.0, "transect"),
    # A wooden wreck broken in two.
    "wreck": Recipe(make_wreck, (0.0, 0.0, 0.6), 90.0, 24.0, "transect"),
    # A tank with targets on stands.
    "tank": Recipe(make_tank, (0.8, 0.0, 0.6), 0.0, 14.0, "sway", room_m=4.0),
}


def find_scene(name: str) -> Recipe | MeshRecipe:
    """Give the recipe of a scene by its name, or of a mesh by its file.

    Raises:
        AsfmError: neither; the message lists the names there are.
    """
    if name in SCENES:
        return SCENES[name]
    path = Path(name)
    if path.suffix or path.exists():
        return MeshRecipe(path)
    raise AsfmError(f"unknown scene {name!r}; known: {', '.join(SCENES)}, or a mesh file")
