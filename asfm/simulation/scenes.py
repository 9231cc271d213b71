"""The scenes that can be asked for by name."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from asfm.errors import AsfmError
from asfm.simulation.hull import make_hull
from asfm.simulation.motions import View
from asfm.simulation.pier import make_pier
from asfm.simulation.scene import Scene
from asfm.simulation.seafloor import make_seafloor


@dataclass(frozen=True)
class Recipe:
    """How to make a scene and how to look at it."""

    make: Callable[[np.random.Generator], Scene]
    target_m: tuple[float, float, float]
    heading_deg: float
    depression_deg: float
    motion: str

    def view(self, range_max_m: float) -> View:
        """Look at the target so that it fills the middle of an image of that range."""
        heading_rad, depression_rad = np.deg2rad([self.heading_deg, self.depression_deg])
        return View(self.target_m, float(heading_rad), float(depression_rad), 0.6 * range_max_m)


SCENES: dict[str, Recipe] = {
    "seafloor": Recipe(make_seafloor, (0.0, 0.0, 0.0), 0.0, 25.0, "sway"),
    "pier": Recipe(make_pier, (0.9, 0.0, 0.7), 0.0, 20.0, "transect"),
    "hull": Recipe(make_hull, (0.0, 0.0, 0.0), 70.0, -26.0, "transect"),
}


def find_scene(name: str) -> Recipe:
    """Give a scene's recipe by name.

    Raises:
        AsfmError: no such scene; the message lists those there are.
    """
    if name not in SCENES:
        raise AsfmError(f"unknown scene {name!r}; known: {', '.join(SCENES)}")
    return SCENES[name]
