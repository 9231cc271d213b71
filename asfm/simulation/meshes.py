"""Scenes from somebody's mesh file."""

from pathlib import Path

import numpy as np

from asfm.errors import AsfmError
from asfm.simulation.scene import Scene
from asfm.simulation.shapes import texture

FACE_EDGE_M = 0.1
MAX_FACES = 400_000


def read_mesh(path: Path, rng: np.random.Generator) -> Scene:
    """Read a mesh in metres, z up, from any file that trimesh reads; large faces are cut up to carry texture.

    Raises:
        AsfmError: the file is missing, cannot be read, or holds no faces or no finite ones.
    """
    import trimesh

    if not path.is_file():
        raise AsfmError(f"{path}: expected a mesh file, found none")
    try:
        mesh = trimesh.load(path, force="mesh", process=True)
    except Exception as error:  # trimesh lets the exceptions of a dozen formats through
        raise AsfmError(f"{path}: cannot read a mesh: {' '.join(str(error).split()) or type(error).__name__}") from None
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise AsfmError(f"{path}: expected a mesh with faces, found none")
    if not np.isfinite(mesh.vertices).all():
        raise AsfmError(f"{path}: expected finite vertices, found NaN or infinity in the mesh")
    mesh.fix_normals()
    vertices_m, faces = _cut_up(np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces), float(mesh.area))
    scene = texture(path.stem, (vertices_m, faces), 0.5, rng)
    return Scene(scene.name, vertices_m, faces, scene.reflectivity, scene.grain, bool(mesh.is_watertight))


def _cut_up(vertices_m: np.ndarray, faces: np.ndarray, area_m2: float) -> tuple[np.ndarray, np.ndarray]:
    """Cut faces until no edge is longer than a decimetre, or longer where that would make too many faces."""
    from trimesh.remesh import subdivide_to_size

    edge_m = max(FACE_EDGE_M, 3.5 * (area_m2 / MAX_FACES) ** 0.5)
    if len(faces) > MAX_FACES:
        return vertices_m, faces
    cut_m, cut_faces = subdivide_to_size(vertices_m, faces, edge_m, max_iter=20)
    return np.asarray(cut_m, dtype=float), np.asarray(cut_faces, dtype=np.int64)
