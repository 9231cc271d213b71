"""Scene catalogue: named scenes and mesh files, each with its nominal viewpoint and motion."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asfm.errors import AsfmError, quote
from asfm.regular_file import is_present
from asfm.simulation.scenes.hull import make_hull
from asfm.simulation.scenes.mesh_file import read_mesh
from asfm.simulation.scenes.pier import make_pier
from asfm.simulation.scenes.scene import Scene
from asfm.simulation.scenes.seafloor import make_seafloor
from asfm.simulation.scenes.tank import make_tank
from asfm.simulation.scenes.wreck import make_wreck
from asfm.simulation.vehicle.trajectories import View

TARGET_RANGE_SHARE = 0.6
"""Distance of the target as a share of the sonar's maximum range."""


@dataclass(frozen=True)
class SceneEntry:
    """A generated scene, its nominal viewpoint and its usual motion."""

    make: Callable[[np.random.Generator], Scene]
    target_m: tuple[float, float, float]
    heading_deg: float
    depression_deg: float
    motion: str
    max_distance_m: float = np.inf
    """Largest distance from the target at which the sonar is still inside the scene."""

    def build(self, range_max_m: float, rng: np.random.Generator) -> tuple[Scene, View]:
        """Build the scene, and the view that centres its target in an image of that range."""
        return self.make(rng), self.look(range_max_m)

    def look(self, range_max_m: float) -> View:
        """Return the view that centres the target in an image of that range."""
        heading_rad, depression_rad = np.deg2rad([self.heading_deg, self.depression_deg])
        distance_m = min(TARGET_RANGE_SHARE * range_max_m, self.max_distance_m)
        return View(self.target_m, float(heading_rad), float(depression_rad), distance_m)


@dataclass(frozen=True)
class MeshEntry:
    """A mesh file, viewed from outside and obliquely from above."""

    path: Path
    motion: str = "orbit"

    def build(self, range_max_m: float, rng: np.random.Generator) -> tuple[Scene, View]:
        """Read the mesh; the view has its centre as target and a distance outside of its extent."""
        scene = read_mesh(self.path, rng)
        low, high = scene.vertices_m.min(axis=0), scene.vertices_m.max(axis=0)
        x, y, z = (float(value) for value in 0.5 * (low + high))
        radius_m = float(np.hypot(*(high - low)[:2])) / 2
        distance_m = max(TARGET_RANGE_SHARE * range_max_m, radius_m + 0.3 * range_max_m)
        return scene, View((x, y, z), 0.0, float(np.deg2rad(20.0)), distance_m)


SCENES: dict[str, SceneEntry] = {
    # Boulders of 0.07 to 0.6 m radius on gentle swells.
    "seafloor": SceneEntry(make_seafloor, (0.0, 0.0, 0.0), 0.0, 25.0, "sway"),
    # Two rows of piles with braces in front of a block wall, debris below.
    "pier": SceneEntry(make_pier, (0.9, 0.0, 0.7), 0.0, 20.0, "transect"),
    # A ship's bottom from below: anodes, gratings, outlets, bilge keels.
    "hull": SceneEntry(make_hull, (0.0, 0.0, 0.0), 70.0, -26.0, "transect"),
    # A wooden wreck broken in two.
    "wreck": SceneEntry(make_wreck, (0.0, 0.0, 0.6), 90.0, 24.0, "transect"),
    # A tank with targets on stands.
    "tank": SceneEntry(make_tank, (0.8, 0.0, 0.6), 0.0, 14.0, "sway", max_distance_m=4.0),
}


def find_scene(name: str) -> SceneEntry | MeshEntry:
    """Return a scene by its name, or the one of a mesh file.

    Raises:
        AsfmError: it is neither; the message lists the known names.
    """
    if name in SCENES:
        return SCENES[name]
    path = Path(name)
    if path.suffix or is_present(path):
        return MeshEntry(path)
    raise AsfmError(f"unknown scene {quote(name)}; known: {', '.join(SCENES)}, or a mesh file")
