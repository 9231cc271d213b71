"""Scene: a test tank with targets on stands and smooth, specular walls."""

import numpy as np

from asfm.simulation.scenes.scene import Scene, join_scenes
from asfm.simulation.scenes.shapes import make_ball, make_box, make_pipe, make_sheet, move_mesh, texture

SIZE_M = (14.0, 9.0, 4.0)


def make_tank(rng: np.random.Generator) -> Scene:
    """Build a tank of 14 x 9 x 4 m around the origin, its floor at z = 0, with two dozen targets."""
    length, breadth, depth = SIZE_M
    quarter = np.pi / 2
    floor = make_sheet((length, breadth), 0.08)
    sides = [
        move_mesh(make_sheet((depth, breadth), 0.08), (-length / 2, 0, depth / 2), (0, quarter, 0)),
        move_mesh(make_sheet((depth, breadth), 0.08), (length / 2, 0, depth / 2), (0, -quarter, 0)),
        move_mesh(make_sheet((length, depth), 0.08), (0, -breadth / 2, depth / 2), (0, 0, -quarter)),
        move_mesh(make_sheet((length, depth), 0.08), (0, breadth / 2, depth / 2), (0, 0, quarter)),
    ]
    parts = [texture("floor", floor, 0.06, rng), *(texture("wall", side, 0.06, rng) for side in sides)]
    for number in range(24):
        parts += _make_target(number, rng)
    return join_scenes("tank", parts)


def _make_target(number: int, rng: np.random.Generator) -> list[Scene]:
    """Make a ball, cube, pipe or plate on a thin stand."""
    x, y = rng.uniform([-3.0, -3.2], [4.5, 3.2])
    z = rng.uniform(0.25, 1.4)
    turn = (rng.uniform(-np.pi, np.pi), rng.normal(0, 0.5), rng.normal(0, 0.5))
    kind = number % 4
    if kind == 0:
        target = make_ball(float(rng.uniform(0.08, 0.22)))
    elif kind == 1:
        target = make_box([float(rng.uniform(0.15, 0.4))] * 3, 0.04)
    elif kind == 2:
        half = rng.uniform(0.2, 0.5)
        target = make_pipe(np.array([[-half, 0, 0], [half, 0, 0]]), rng.uniform(0.04, 0.1), rng)
    else:
        target = make_box((0.5, 0.5, 0.03), 0.04)
    stand = make_pipe(np.array([[x, y, 0.0], [x, y, z]]), 0.02, rng)
    return [texture("target", move_mesh(target, (x, y, z), turn), 0.8, rng), texture("stand", stand, 0.5, rng)]
