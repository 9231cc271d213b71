"""Mesh primitives of the scenes: rocks, sheets, ground, pipes, boxes and balls, with textured reflectivity.

Faces are a few centimetres wide, since reflectivity is stored per face, and wound outward.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np

from asfm.simulation.scenes.scene import Scene
from asfm.types import FloatArray, IntArray

Mesh = tuple[FloatArray, IntArray]
"""(V, 3) vertices in metres and (F, 3) faces."""


def wave_field(points_m: FloatArray, wavelength_m: tuple[float, float], rng: np.random.Generator) -> FloatArray:
    """Evaluate a smooth random field of unit variance, a sum of plane waves.

    Args:
        points_m: (N, D) points.
        wavelength_m: shortest and longest wavelength; wavelengths are log-uniform.
        rng: source of directions, wavelengths and phases.

    Returns:
        (N,) values.
    """
    modes = 32
    dimensions = points_m.shape[1]
    direction = rng.normal(size=(dimensions, modes))
    direction /= np.linalg.norm(direction, axis=0)
    shortest, longest = wavelength_m
    wavelength = shortest * (longest / shortest) ** rng.uniform(size=modes)
    phase = rng.uniform(0, 2 * np.pi, modes)
    angle = points_m.astype(np.float32) @ (2 * np.pi * direction / wavelength).astype(np.float32)
    angle += phase.astype(np.float32)
    np.cos(angle, out=angle)
    return np.asarray(angle.sum(axis=1) * np.sqrt(2 / modes), dtype=float)


def texture(name: str, mesh: Mesh, level: float, rng: np.random.Generator) -> Scene:
    """Make a scene of a mesh with a random reflectivity of mean about ``level``: patches, facets and grain."""
    vertices_m, faces = mesh
    centres_m = vertices_m[faces].mean(axis=1)
    patches = 0.35 * wave_field(centres_m, (0.25, 1.5), rng) + 0.3 * wave_field(centres_m, (0.06, 0.25), rng)
    faceted = 0.15 * rng.standard_normal(len(faces))
    return Scene(name, vertices_m, faces, level * np.exp(patches + faceted - 0.1), grain=0.45)


def join_meshes(meshes: Sequence[Mesh]) -> Mesh:
    """Concatenate several meshes."""
    offsets = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = [faces + offset for (_, faces), offset in zip(meshes, offsets[:-1], strict=True)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


def move_mesh(mesh: Mesh, place_m: Sequence[float], turn_rad: Sequence[float] = (0.0, 0.0, 0.0)) -> Mesh:
    """Rotate a mesh by yaw, pitch and roll about the origin, then translate it."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("ZYX", list(turn_rad)).apply(mesh[0]) + np.array(place_m), mesh[1]


def make_rock(radius_m: float, rng: np.random.Generator) -> Mesh:
    """Make an irregular rock around the origin: a stretched ball, cut by planes and roughened."""
    direction, faces = _ball(2 if radius_m < 0.1 else 3 if radius_m < 0.25 else 4)
    reach = 1 + 0.16 * wave_field(direction, (1.2, 2.5), rng) + 0.05 * wave_field(direction, (0.35, 0.9), rng)
    cuts = rng.normal(size=(9, 3))
    cuts /= np.linalg.norm(cuts, axis=1, keepdims=True)
    along = direction @ cuts.T
    limit = rng.uniform(0.6, 1.0, len(cuts)) / np.maximum(along, 1e-6)
    reach = np.minimum(reach, limit.min(axis=1))
    reach += 0.03 * wave_field(direction, (0.2, 0.5), rng)
    stretch = rng.uniform(0.65, 1.25, 3)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    return radius_m * (direction * reach[:, None] * stretch) @ turn.T, faces


@cache
def _ball(subdivisions: int) -> Mesh:
    """Return an icosphere of radius 1."""
    from trimesh.creation import icosphere

    ball = icosphere(subdivisions=subdivisions)
    return np.asarray(ball.vertices, dtype=float), np.asarray(ball.faces, dtype=np.int64)


def make_ball(radius_m: float, subdivisions: int = 4) -> Mesh:
    """Make a smooth ball around the origin."""
    direction, faces = _ball(subdivisions)
    return radius_m * direction, faces


def grid_faces(rows: int, columns: int) -> IntArray:
    """Triangulate a (rows, columns) grid of vertices, (F, 3); normals point along row axis x column axis."""
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    one = np.stack([corner, corner + columns, corner + columns + 1], axis=-1)
    other = np.stack([corner, corner + columns + 1, corner + 1], axis=-1)
    return np.concatenate([one, other])


def make_sheet(size_m: tuple[float, float], step_m: float) -> Mesh:
    """Make a flat sheet in the x-y plane around the origin, facing up; vertices are ordered along y fastest."""
    rows, columns = (max(2, round(size / step_m) + 1) for size in size_m)
    x, y = np.meshgrid(
        np.linspace(-0.5, 0.5, rows) * size_m[0], np.linspace(-0.5, 0.5, columns) * size_m[1], indexing="ij"
    )
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=-1), grid_faces(rows, columns)


def make_ground(
    size_m: tuple[float, float], rng: np.random.Generator, swell_m: float = 0.07, step_m: float = 0.06
) -> Mesh:
    """Make ground around the origin, facing up: undulations of standard deviation ``swell_m`` and ripples of 1 cm."""
    vertices_m, faces = make_sheet(size_m, step_m)
    plan_m = vertices_m[:, :2]
    height_m = swell_m * wave_field(plan_m, (2.5, 8.0), rng) + 0.012 * wave_field(plan_m, (0.25, 1.2), rng)
    vertices_m[:, 2] = height_m + 0.003 * rng.standard_normal(len(plan_m))
    return vertices_m, faces


def make_box(size_m: Sequence[float], step_m: float = 0.06) -> Mesh:
    """Make a box around the origin out of six sheets."""
    x, y, z = size_m
    quarter = np.pi / 2
    return join_meshes(
        [
            move_mesh(make_sheet((x, y), step_m), (0, 0, z / 2)),
            move_mesh(make_sheet((x, y), step_m), (0, 0, -z / 2), (0, 0, np.pi)),
            move_mesh(make_sheet((z, y), step_m), (x / 2, 0, 0), (0, quarter, 0)),
            move_mesh(make_sheet((z, y), step_m), (-x / 2, 0, 0), (0, -quarter, 0)),
            move_mesh(make_sheet((x, z), step_m), (0, y / 2, 0), (0, 0, -quarter)),
            move_mesh(make_sheet((x, z), step_m), (0, -y / 2, 0), (0, 0, quarter)),
        ]
    )


def make_pipe(
    path_m: FloatArray, radius_m: float, rng: np.random.Generator, rough_m: float = 0.0, step_m: float = 0.05
) -> Mesh:
    """Make a closed pipe along a (P, 3) path; its surface is roughened outward by about ``rough_m``."""
    length_m = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path_m, axis=0), axis=1))])
    rings = max(3, round(length_m[-1] / step_m) + 1)
    sides = max(10, round(2 * np.pi * radius_m / step_m))
    at_m = np.linspace(0, length_m[-1], rings)
    centre = np.stack([np.interp(at_m, length_m, path_m[:, axis]) for axis in range(3)], axis=-1)
    ahead = np.gradient(centre, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    aside = np.array([1.0, 0, 0]) if abs(ahead[0, 0]) < 0.9 else np.array([0, 1.0, 0])
    first = np.cross(ahead, aside)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(ahead, first)
    turn = np.linspace(0, 2 * np.pi, sides + 1)
    out = np.cos(turn)[:, None, None] * first + np.sin(turn)[:, None, None] * second  # (sides + 1, rings, 3)
    skin = (centre + radius_m * out).reshape(-1, 3)
    growth = rough_m * (np.abs(wave_field(skin, (0.1, 0.5), rng)) + 0.4 * wave_field(skin, (0.05, 0.12), rng))
    reach = radius_m + growth.reshape(sides + 1, rings, 1)
    reach[-1] = reach[0]
    reach[:, [0, -1]] *= 1e-3  # the caps
    return (centre + reach * out).reshape(-1, 3), grid_faces(sides + 1, rings)
