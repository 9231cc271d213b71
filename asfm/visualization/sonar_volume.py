"""The sonar's field of view in 3-D: frustum edges, and the image plane of zero elevation as a textured mesh."""

from typing import Any

import numpy as np

from asfm.geometry.sonar import SonarModel, back_project
from asfm.types import FloatArray

MESH_ROWS, MESH_COLUMNS = 8, 32


def outline_frustum(sonar: SonarModel) -> list[FloatArray]:
    """Return (P, 3) line strips (m, sonar frame) along the edges of the volume that a sonar sees."""
    bearings, elevations = np.linspace(sonar.bearing_edges_rad[0], sonar.bearing_edges_rad[-1], 33), sonar.elevations(9)
    near_far = sonar.range_edges_m[[0, -1]]
    fans = [back_project(r, bearings, phi) for r in near_far for phi in elevations[[0, -1]]]
    uprights = [back_project(r, theta, elevations) for r in near_far for theta in bearings[[0, -1]]]
    sides = [back_project(near_far, theta, phi) for theta in bearings[[0, -1]] for phi in elevations[[0, -1]]]
    return fans + uprights + sides


def tessellate_image_plane(sonar: SonarModel) -> dict[str, Any]:
    """Tessellate the surface of zero elevation for a texture of the polar image.

    Returns:
        ``vertex_positions`` (V, 3) in m in the sonar frame, ``vertex_texcoords`` (V, 2) in 0..1 and
        ``triangle_indices`` (T, 3), as Rerun's Mesh3D takes them.
    """
    rows, columns = MESH_ROWS, MESH_COLUMNS
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    range_m, bearing_rad = sonar.range_at_row(v * sonar.shape[0]), sonar.bearing_at_column(u * sonar.shape[1])
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1, 1)
    return {
        "vertex_positions": back_project(range_m, bearing_rad, 0.0).reshape(-1, 3),
        "vertex_texcoords": np.stack([u, v], axis=-1).reshape(-1, 2),
        "triangle_indices": (corner + np.array([0, 1, columns + 2, 0, columns + 2, columns + 1])).reshape(-1, 3),
    }
