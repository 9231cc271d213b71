"""Rocks, boxes, pipes and ground: the bricks of the scenes."""

import numpy as np

from asfm.simulation.scene import Scene
from asfm.types import FloatArray, IntArray


def wave_field(points_m: FloatArray, wavelength_m: tuple[float, float], rng: np.random.Generator) -> FloatArray:
    """Evaluate a smooth random field of unit variance at (N, D) points: a sum of plane waves. (N,)."""
    modes = 48
    dimensions = points_m.shape[1]
    direction = rng.normal(size=(dimensions, modes))
    direction /= np.linalg.norm(direction, axis=0)
    shortest, longest = wavelength_m
    wavelength = shortest * (longest / shortest) ** rng.uniform(size=modes)
    phase = rng.uniform(0, 2 * np.pi, modes)
    angle = points_m.astype(np.float32) @ (2 * np.pi * direction / wavelength).astype(np.float32)
    angle += phase.astype(np.float32)
    return np.asarray(np.cos(angle).sum(axis=1) * np.sqrt(2 / modes), dtype=float)


def textured(name: str, vertices_m: FloatArray, faces: IntArray, level: float, rng: np.random.Generator) -> Scene:
    """Give a mesh a reflectivity of mean about ``level`` that stays with it: patches, and grain from face to face."""
    centres_m = vertices_m[faces].mean(axis=1)
    patches = 0.35 * wave_field(centres_m, (0.25, 1.5), rng) + 0.3 * wave_field(centres_m, (0.06, 0.25), rng)
    grain = 0.35 * rng.standard_normal(len(faces))
    return Scene(name, vertices_m, faces, level * np.exp(patches + grain - 0.15))


def make_rock(radius_m: float, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
    """Carve an irregular rock around the origin: a stretched ball, cut by planes and roughened."""
    from trimesh.creation import icosphere

    ball = icosphere(subdivisions=4 if radius_m > 0.2 else 3)
    direction = np.asarray(ball.vertices, dtype=float)
    reach = 1 + 0.16 * wave_field(direction, (1.2, 2.5), rng) + 0.05 * wave_field(direction, (0.35, 0.9), rng)
    cuts = rng.normal(size=(9, 3))
    cuts /= np.linalg.norm(cuts, axis=1, keepdims=True)
    along = direction @ cuts.T
    limit = rng.uniform(0.6, 1.0, len(cuts)) / np.maximum(along, 1e-6)
    reach = np.minimum(reach, np.where(along > 0, limit, np.inf).min(axis=1))
    reach += 0.03 * wave_field(direction, (0.2, 0.5), rng)
    stretch = rng.uniform(0.65, 1.25, 3)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    return radius_m * (direction * reach[:, None] * stretch) @ turn.T, np.asarray(ball.faces, dtype=np.int64)


def make_ground(size_m: tuple[float, float], step_m: float, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
    """Lay a sheet of ground around the origin: swells of decimetres, ripples of a centimetre. Faces up."""
    columns, rows = (round(size / step_m) + 1 for size in size_m)
    x, y = np.meshgrid(*(np.linspace(-size / 2, size / 2, n) for size, n in zip(size_m, (columns, rows), strict=True)))
    points_m = np.stack([x.ravel(), y.ravel()], axis=-1)
    height = 0.07 * wave_field(points_m, (2.5, 8.0), rng) + 0.012 * wave_field(points_m, (0.25, 1.2), rng)
    height += 0.003 * rng.standard_normal(len(points_m))
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + columns + 1], axis=-1)
    upper = np.stack([corner, corner + columns + 1, corner + columns], axis=-1)
    return np.column_stack([points_m, height]), np.concatenate([lower, upper])
