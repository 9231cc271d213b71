"""Scene: a small wreck, broken in two and half buried in the seafloor, with scattered cargo."""

import numpy as np

from asfm.simulation.scenes.scene import Scene, join_scenes
from asfm.simulation.scenes.seafloor import strew_rocks
from asfm.simulation.scenes.shapes import (
    Mesh,
    grid_faces,
    make_ball,
    make_box,
    make_ground,
    make_pipe,
    move_mesh,
    texture,
)
from asfm.types import BoolArray, FloatArray

HALF_LENGTH_M = 4.5
HALF_BREADTH_M = 1.5
DEPTH_M = 1.7
RIBS = 9
STRAKE_M = 0.21


def make_wreck(rng: np.random.Generator) -> Scene:
    """Build a wreck of 10 m along x around the origin, on ground at a height of about zero."""
    ground = make_ground((20.0, 20.0), rng)
    parts = [texture("ground", ground, 0.25, rng)]
    fore = ((0.4, 0.2, -0.15), (0.12, 0.05, 0.35))
    aft = ((-0.8, -0.3, -0.2), (np.pi - 0.1, 0.08, -0.25))
    for place, turn in (fore, aft):
        parts += [texture("wreck", move_mesh(piece, place, turn), level, rng) for piece, level in _make_half(rng)]
    parts += _make_cargo(rng)
    parts += strew_rocks(ground[0], 0.15, 0.12, rng)
    return join_scenes("wreck", parts)


def _section(along: FloatArray, around: FloatArray, shrink_m: float) -> FloatArray:
    """Return points on half a hull that narrows towards its end.

    Args:
        along: position along the hull, 0..1.
        around: position in the cross-section, -1..1 from gunwale to gunwale.
        shrink_m: distance of the points inside the outer skin.

    Returns:
        (..., 3) points.
    """
    narrow = np.sqrt(np.clip(1 - along**2.5, 0.0, 1))
    turn = around * np.pi / 2
    y = -(HALF_BREADTH_M * narrow - shrink_m) * np.sign(np.sin(turn)) * np.abs(np.sin(turn)) ** 0.7
    z = DEPTH_M + 0.25 * along**2 - (DEPTH_M - shrink_m) * np.abs(np.cos(turn)) ** 0.7 * (0.25 + 0.75 * narrow)
    return np.stack([HALF_LENGTH_M * along, y, z], axis=-1)


def _make_half(rng: np.random.Generator) -> list[tuple[Mesh, float]]:
    """Make (mesh, reflectivity) of half a hull: planking with holes, ribs, a part of the deck and a broken mast."""
    rows, columns = 70, 90
    along, around = np.meshgrid(np.linspace(0, 0.985, rows), np.linspace(-1, 1, columns), indexing="ij")
    holes = rng.uniform(size=(11, 13, 2)) < 0.13
    pieces = []
    for shrink_m, outward in ((0.0, True), (0.06, False)):
        skin = _section(along, around, shrink_m).reshape(-1, 3)
        faces = grid_faces(rows, columns)
        kept = _keep_planks(skin[faces].mean(axis=1), holes)
        pieces.append(((skin, faces[kept] if outward else faces[kept][:, ::-1]), 0.6))
    for rib in np.linspace(0.05, 0.9, RIBS):
        line = _section(np.full(24, rib), np.linspace(-0.98, 0.98, 24), 0.12)
        pieces.append((make_pipe(line, 0.05, rng, rough_m=0.005), 0.9))
    deck = make_box((1.5, 1.9, 0.06))
    pieces.append((move_mesh(deck, (3.0, 0, DEPTH_M), (0, 0.03, 0.04)), 0.7))
    mast = np.array([[1.2, 0.0, 0.3], [1.5, 0.4, 2.9]])
    pieces.append((make_pipe(mast, 0.09, rng, rough_m=0.008), 0.9))
    return pieces


def _keep_planks(centre_m: FloatArray, holes: BoolArray) -> BoolArray:
    """Return which faces, (F,) by centre, remain: planks are missing at the same places inside and outside."""
    strake = (centre_m[:, 2] / STRAKE_M).astype(int)
    plank = (centre_m[:, 0] / 0.9 + 0.37 * strake).astype(int)
    whole: BoolArray = ~holes[strake % holes.shape[0], plank % holes.shape[1], (centre_m[:, 1] > 0).astype(int)]
    return whole


def _make_cargo(rng: np.random.Generator) -> list[Scene]:
    """Make crates, barrels, cannon balls and a chain around the wreck."""
    parts = []
    for _ in range(26):
        place = (*rng.normal(0, 2.6, 2), rng.uniform(0.05, 0.2))
        turn = (rng.uniform(-np.pi, np.pi), rng.normal(0, 0.2), rng.normal(0, 0.2))
        kind = rng.integers(3)
        if kind == 0:
            item = make_box(rng.uniform(0.2, 0.6, 3).tolist())
        elif kind == 1:
            item = make_pipe(np.array([[-0.4, 0, 0], [0.4, 0, 0]]), 0.22, rng, rough_m=0.004)
        else:
            item = make_ball(float(rng.uniform(0.08, 0.18)), 3)
        parts.append(texture("litter", move_mesh(item, place, turn), 0.9, rng))
    bend = np.linspace(0, 1, 60)
    chain = np.stack([-3 + 5 * bend, -2.5 + 0.6 * np.sin(7 * bend), np.full(60, 0.06)], axis=-1)
    parts.append(texture("chain", make_pipe(chain, 0.05, rng, rough_m=0.03), 1.0, rng))
    return parts
