"""Scene: the underwater hull of a ship with its fittings, seen from below."""

import numpy as np

from asfm.simulation.scenes.scene import Scene, join_scenes
from asfm.simulation.scenes.shapes import (
    Mesh,
    grid_faces,
    make_ball,
    make_box,
    make_pipe,
    make_rock,
    move_mesh,
    texture,
)
from asfm.types import FloatArray

LENGTH_M = 32.0
BREADTH_M = 7.0
DRAFT_M = 3.0
STEP_M = 0.07


def make_hull(rng: np.random.Generator) -> Scene:
    """Build a hull along x around the origin, its flat bottom at z = 0, the waterline at z = 3."""
    parts = [texture("plating", _make_plating(rng), 0.3, rng)]
    parts += _make_fittings(rng)
    parts += _make_stern_gear(rng)
    for _ in range(260):
        place = _hull_point(rng.uniform(-0.46, 0.46) * LENGTH_M, rng.uniform(0, 1) * rng.choice([-1, 1]))
        parts.append(texture("growth", move_mesh(make_rock(float(rng.uniform(0.03, 0.09)), rng), place), 0.8, rng))
    return join_scenes("hull", parts)


def _fullness(along_m: FloatArray) -> FloatArray:
    """Return the ratio of the local to the full breadth: fine ends, a long parallel midbody."""
    return np.asarray(np.sqrt(np.clip(1 - np.abs(along_m / (LENGTH_M / 2)) ** 3.5, 0.0, 1)))


def _section(along_m: FloatArray, around: FloatArray) -> FloatArray:
    """Return points on the hull, (..., 3); ``around`` is -1 at the port waterline, 0 at the keel, 1 at starboard."""
    half_m = BREADTH_M / 2 * _fullness(along_m)
    turn = around * np.pi / 2
    # A superellipse of exponent 5: flat bottom, round bilge, vertical side.
    bend = (np.abs(np.sin(turn)) ** 5 + np.abs(np.cos(turn)) ** 5) ** 0.2
    y = -half_m * np.sin(turn) / bend
    z = DRAFT_M * (1 - np.cos(turn) / bend)
    return np.stack([along_m, y, z], axis=-1)


def _hull_point(along_m: float, around: float) -> list[float]:
    """Return one point on the hull, [x, y, z]."""
    return [float(value) for value in _section(np.array(along_m), np.array(around))]


def _make_plating(rng: np.random.Generator) -> Mesh:
    """Make the plating: welds that protrude by a few millimetres, and dents between the frames."""
    rows, columns = round(LENGTH_M / STEP_M), round((BREADTH_M + 2 * DRAFT_M) / STEP_M)
    along, around = np.meshgrid(np.linspace(-0.499, 0.499, rows) * LENGTH_M, np.linspace(-1, 1, columns), indexing="ij")
    skin = _section(along, around)
    dent = 0.006 * np.sin(2 * np.pi * along / 0.75) * np.sin(8 * np.pi * around)
    weld = np.where((along % 2.4 < STEP_M) | (np.abs((around * 4) % 1 - 0.5) < 0.012), 0.012, 0.0)
    skin[..., 2] -= dent + weld + 0.002 * rng.standard_normal(dent.shape)
    return skin.reshape(-1, 3), grid_faces(rows, columns)


def _make_fittings(rng: np.random.Generator) -> list[Scene]:
    """Make anodes, gratings, a dome, pipe outlets and the bilge keels."""
    parts = []
    for _ in range(70):
        x, y, _ = place = _hull_point(rng.uniform(-0.42, 0.42) * LENGTH_M, rng.uniform(-0.55, 0.55))
        place[2] -= 0.03
        size = rng.uniform([0.2, 0.08, 0.06], [0.5, 0.2, 0.12])
        anode = move_mesh(make_box(size.tolist(), 0.04), place, (rng.choice([0.0, 0.0, np.pi / 2]), 0, 0))
        parts.append(texture("anode", anode, 1.1, rng))
    for _ in range(14):
        place = _hull_point(rng.uniform(-0.4, 0.4) * LENGTH_M, rng.uniform(-0.45, 0.45))
        side_m, bars = rng.uniform(0.4, 0.8), 5
        for bar in np.linspace(-side_m / 2, side_m / 2, bars):
            slat = make_box((side_m, 0.05, 0.08), 0.05)
            parts.append(texture("grating", move_mesh(slat, [place[0], place[1] + bar, place[2] - 0.04]), 0.9, rng))
    for _ in range(16):
        x, y, z = _hull_point(rng.uniform(-0.42, 0.42) * LENGTH_M, rng.uniform(-0.5, 0.5))
        outlet = make_pipe(np.array([[x, y, z + 0.1], [x, y, z - rng.uniform(0.06, 0.2)]]), rng.uniform(0.08, 0.2), rng)
        parts.append(texture("outlet", outlet, 0.9, rng))
    dome = move_mesh(make_ball(0.3), _hull_point(0.22 * LENGTH_M, 0.1))
    parts.append(texture("dome", dome, 0.8, rng))
    for side in (-1, 1):
        along = np.linspace(-0.25, 0.25, 40) * LENGTH_M
        line = _section(along, np.full(40, 0.5 * side)) + np.array([0, -0.12 * side, -0.12])
        parts.append(texture("bilge keel", make_pipe(line, 0.09, rng, rough_m=0.004), 0.8, rng))
    return parts


def _make_stern_gear(rng: np.random.Generator) -> list[Scene]:
    """Make a shaft, a propeller with four blades and a rudder, aft (-x)."""
    aft = -0.40 * LENGTH_M
    shaft = make_pipe(np.array([[aft + 4.0, 0, 0.1], [aft, 0, -0.5]]), 0.1, rng)
    parts = [texture("shaft", shaft, 1.0, rng)]
    parts.append(texture("hub", move_mesh(make_ball(0.2, 3), (aft, 0, -0.5)), 1.0, rng))
    for quarter in range(4):
        blade = move_mesh(make_box((0.05, 0.32, 0.6)), (0, 0, 0.42), (0.6, 0, 0))
        parts.append(texture("blade", move_mesh(blade, (aft, 0, -0.5), (0, 0, quarter * np.pi / 2 + 0.3)), 1.1, rng))
    parts.append(texture("rudder", move_mesh(make_box((0.9, 0.14, 1.6)), (aft - 0.9, 0, -0.2)), 0.7, rng))
    return parts
