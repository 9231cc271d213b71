"""Scene: a seafloor with boulders."""

import numpy as np

from asfm.simulation.scenes.scene import Scene, join_scenes
from asfm.simulation.scenes.shapes import make_ground, make_rock, move_mesh, texture
from asfm.types import FloatArray

GROUND_STEP_M = 0.06


def make_seafloor(
    rng: np.random.Generator, size_m: tuple[float, float] = (18.0, 18.0), boulders_per_m2: float = 0.7
) -> Scene:
    """Build a seafloor with boulders of 0.07 to 0.6 m radius, around the origin at a height of about zero."""
    ground = make_ground(size_m, rng, step_m=GROUND_STEP_M)
    return join_scenes(
        "seafloor", [texture("ground", ground, 0.3, rng), *strew_rocks(ground[0], boulders_per_m2, 0.2, rng)]
    )


def strew_rocks(ground_m: FloatArray, rocks_per_m2: float, radius_m: float, rng: np.random.Generator) -> list[Scene]:
    """Scatter rocks over the vertices of a ground.

    Args:
        ground_m: (V, 3) vertices.
        rocks_per_m2: density.
        radius_m: median radius; sizes are log-normal, clipped to 0.35 to 3 times the median.
        rng: source of positions and sizes.

    Returns:
        One scene per rock.
    """
    area_m2 = float(np.prod(np.ptp(ground_m[:, :2], axis=0)))
    rocks = []
    for _ in range(round(rocks_per_m2 * area_m2)):
        size_m = radius_m * float(np.clip(np.exp(0.5 * rng.standard_normal()), 0.35, 3.0))
        place = ground_m[rng.integers(len(ground_m))] + np.array([0, 0, size_m * rng.uniform(-0.1, 0.6)])
        rock = move_mesh(make_rock(size_m, rng), place)
        rocks.append(texture("rock", rock, 0.8 * float(np.exp(0.3 * rng.standard_normal())), rng))
    return rocks
