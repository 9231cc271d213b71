"""Scenes from mesh files (OBJ, PLY, STL, glTF and other formats of trimesh)."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from asfm.errors import AsfmError
from asfm.simulation.scenes.scene import Scene
from asfm.simulation.scenes.shapes import texture
from asfm.types import FloatArray, IntArray

if TYPE_CHECKING:
    import trimesh

FACE_EDGE_M = 0.1
MAX_FACES = 400_000
MAX_SIZE_M = 1e5
"""Rays are cast in float32; a larger mesh is in other units than metres, or damaged."""


def read_mesh(path: Path, rng: np.random.Generator) -> Scene:
    """Read a mesh in metres, z up, from any format that trimesh reads; large faces are subdivided to carry texture.

    Args:
        path: the file.
        rng: source of the reflectivity.

    Raises:
        AsfmError: the file is missing, cannot be read, or holds no faces, none with an area, a corner that is not
            finite, or is larger than 100 km.
    """
    mesh = _load(path)
    _check_extent(path, mesh)
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces())
    if not len(mesh.faces):
        raise AsfmError(f"{path}: expected a mesh with faces, found only faces without an area")
    mesh.remove_unreferenced_vertices()
    mesh.fix_normals()
    vertices_m, faces = _subdivide(np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces), float(mesh.area))
    scene = texture(path.stem, (vertices_m, faces), 0.5, rng)
    return Scene(scene.name, vertices_m, faces, scene.reflectivity, scene.grain, bool(mesh.is_watertight))


def _load(path: Path) -> "trimesh.Trimesh":
    """Load a mesh file, whose faces are not yet checked."""
    import trimesh

    if path.is_dir():
        raise AsfmError(f"{path}: expected a mesh file, found a folder")
    if not path.is_file():
        raise AsfmError(f"{path}: expected a mesh file, found none")
    kind = path.suffix.lower().removeprefix(".")
    if kind not in trimesh.available_formats():
        raise AsfmError(f"{path}: expected a mesh such as .obj, .ply, .stl or .glb, found {path.suffix or 'no suffix'}")
    try:
        mesh = trimesh.load(path, force="mesh", process=False)
    except (ImportError, KeyError, IndexError, TypeError, AttributeError):
        # These exceptions of a format's reader describe its code, not the file.
        raise AsfmError(f"{path}: cannot read a mesh: the file is damaged, or not what its suffix says") from None
    except Exception as error:  # trimesh passes on the exceptions of a dozen formats
        raise AsfmError(f"{path}: cannot read a mesh: {' '.join(str(error).split()) or type(error).__name__}") from None
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise AsfmError(f"{path}: expected a mesh with faces, found none")
    return mesh


def _check_extent(path: Path, mesh: "trimesh.Trimesh") -> None:
    """Check that the faces refer to finite vertices within MAX_SIZE_M."""
    faces = np.asarray(mesh.faces)
    if faces.min() < 0 or faces.max() >= len(mesh.vertices):
        raise AsfmError(f"{path}: expected faces among {len(mesh.vertices)} vertices, found number {faces.max()}")
    corners = np.asarray(mesh.vertices)[faces].reshape(-1, 3)
    if not np.isfinite(corners).all():
        raise AsfmError(f"{path}: expected finite vertices, found NaN or infinity in the mesh")
    with np.errstate(over="ignore"):
        size_m = float(np.ptp(corners, axis=0).max())
    if size_m > MAX_SIZE_M:
        raise AsfmError(f"{path}: expected a mesh in metres, {MAX_SIZE_M:g} m across at most, found {size_m:.3g} m")


def _subdivide(vertices_m: FloatArray, faces: IntArray, area_m2: float) -> tuple[FloatArray, IntArray]:
    """Subdivide faces until no edge is longer than FACE_EDGE_M, or longer for a mesh of more than MAX_FACES."""
    from trimesh.remesh import subdivide_to_size

    edge_m = max(FACE_EDGE_M, 3.5 * (area_m2 / MAX_FACES) ** 0.5)
    if len(faces) > MAX_FACES:
        return vertices_m, faces
    fine_m, fine_faces = subdivide_to_size(vertices_m, faces, edge_m, max_iter=20)
    return np.asarray(fine_m, dtype=float), np.asarray(fine_faces, dtype=np.int64)
