"""Scene: a quay wall behind rows of piles, with braces, fenders, growth and debris on the bottom."""

from itertools import pairwise

import numpy as np

from asfm.simulation.scenes.scene import Scene, join_scenes
from asfm.simulation.scenes.seafloor import strew_rocks
from asfm.simulation.scenes.shapes import (
    Mesh,
    make_box,
    make_ground,
    make_pipe,
    make_rock,
    make_sheet,
    move_mesh,
    texture,
    wave_field,
)

LENGTH_M = 26.0
HEIGHT_M = 5.0
WALL_X_M = 3.0
ROWS_X_M = (0.6, 2.0)


def make_pier(rng: np.random.Generator) -> Scene:
    """Build a pier along y: bottom at z = 0, wall at x = 3 facing -x, two rows of piles in front of it."""
    ground = make_ground((14.0, LENGTH_M), rng, swell_m=0.05)
    ground[0][:, 0] -= 3.5
    parts = [texture("bottom", ground, 0.25, rng), texture("wall", _make_wall(rng), 0.45, rng)]
    parts += _make_piles(rng)
    parts += _make_growth(rng)
    parts += _make_debris(rng)
    parts += strew_rocks(ground[0], 0.25, 0.12, rng)
    return join_scenes("pier", parts)


def _make_wall(rng: np.random.Generator) -> Mesh:
    """Make a wall of concrete blocks that protrude unevenly, with joints between them."""
    vertices_m, faces = make_sheet((HEIGHT_M, LENGTH_M), 0.05)
    up_m, along_m = vertices_m[:, 0] + HEIGHT_M / 2, vertices_m[:, 1]
    course = (up_m // 0.62).astype(int)
    offset = rng.uniform(0, 1.1, course.max() + 1)[course]
    column = ((along_m + LENGTH_M / 2 + offset) // 1.1).astype(int)
    out_m = rng.uniform(0, 0.09, (course.max() + 1, column.max() + 1))[course, column]
    joint = (up_m % 0.62 < 0.05) | ((along_m + LENGTH_M / 2 + offset) % 1.1 < 0.05)
    out_m = np.where(joint, -0.05, out_m) + 0.008 * wave_field(vertices_m[:, :2], (0.1, 0.6), rng)
    # The sheet is turned upright: its x axis runs up the wall, its normal points to -x.
    return np.stack([WALL_X_M - out_m, along_m, up_m], axis=-1), faces


def _make_piles(rng: np.random.Generator) -> list[Scene]:
    """Make rows of piles, some of them joined by braces."""
    parts = []
    for row_x in ROWS_X_M:
        along = -LENGTH_M / 2 + 0.8
        feet = []
        while along < LENGTH_M / 2 - 0.5:
            feet.append([row_x + rng.normal(0, 0.08), along, -0.3])
            along += rng.uniform(1.5, 2.3)
        tops = [[x + rng.normal(0, 0.08), y + rng.normal(0, 0.08), HEIGHT_M] for x, y, _ in feet]
        for foot, top in zip(feet, tops, strict=True):
            pile = make_pipe(np.array([foot, top]), rng.uniform(0.14, 0.22), rng, rough_m=0.02)
            parts.append(texture("pile", pile, 0.7, rng))
        for (x, y, _), (x2, y2, _) in pairwise(feet):
            if rng.uniform() < 0.6:
                ends = rng.uniform([0.2, 1.0], [1.2, 3.4])[:: rng.choice([-1, 1])]
                brace = make_pipe(np.array([[x, y, ends[0]], [x2, y2, ends[1]]]), 0.06, rng, rough_m=0.008)
                parts.append(texture("brace", brace, 0.8, rng))
    return parts


def _make_growth(rng: np.random.Generator) -> list[Scene]:
    """Make clumps of mussels on the wall, and fenders in front of it."""
    parts = []
    for _ in range(int(LENGTH_M * 5)):
        place = (WALL_X_M - 0.05, rng.uniform(-0.5, 0.5) * LENGTH_M, HEIGHT_M * rng.uniform(0.02, 1) ** 1.3)
        clump = move_mesh(make_rock(float(rng.uniform(0.05, 0.14)), rng), place)
        parts.append(texture("clump", clump, 0.9, rng))
    for _ in range(int(LENGTH_M / 3)):
        y, low = rng.uniform(-0.48, 0.48) * LENGTH_M, rng.uniform(0.4, 2.0)
        fender = make_pipe(np.array([[2.75, y, low], [2.75, y, low + 1.2]]), 0.14, rng, rough_m=0.004)
        parts.append(texture("fender", fender, 0.6, rng))
    return parts


def _make_debris(rng: np.random.Generator) -> list[Scene]:
    """Make tyres, pipes and crates on the bottom."""
    parts = []
    for _ in range(int(LENGTH_M * 1.3)):
        place = (rng.uniform(-4.0, 2.4), rng.uniform(-0.48, 0.48) * LENGTH_M, rng.uniform(0.02, 0.12))
        turn = (rng.uniform(0, 2 * np.pi), rng.normal(0, 0.2), rng.normal(0, 0.2))
        kind = rng.integers(3)
        if kind == 0:
            angle_rad = np.linspace(0, 2 * np.pi, 30)
            ring = 0.28 * np.stack([np.cos(angle_rad), np.sin(angle_rad), 0 * angle_rad], axis=-1)
            item = make_pipe(ring, 0.09, rng, rough_m=0.003, step_m=0.04)
        elif kind == 1:
            half = rng.uniform(0.4, 1.1)
            item = make_pipe(np.array([[-half, 0, 0], [half, 0, 0]]), rng.uniform(0.04, 0.1), rng, rough_m=0.004)
        else:
            item = make_box(rng.uniform(0.2, 0.6, 3).tolist())
        parts.append(texture("debris", move_mesh(item, place, turn), 0.9, rng))
    return parts
