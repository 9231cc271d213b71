"""Scenes from mesh files (OBJ, PLY, STL, glTF and other formats of trimesh)."""

import bz2
import io
import logging
import struct
import zipfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from asfm.errors import AsfmError, shorten
from asfm.file_kinds import SNIFFED_BYTES, name_kind
from asfm.regular_file import check_file, read_file
from asfm.simulation.scenes.mesh_resolver import FolderResolver
from asfm.simulation.scenes.mesh_subdivision import count_quarters, cut_long_faces
from asfm.simulation.scenes.scene import Scene
from asfm.simulation.scenes.shapes import texture
from asfm.types import FloatArray, IntArray

if TYPE_CHECKING:
    import trimesh

FACE_EDGE_M = 0.1
MAX_FACES = 400_000
MAX_BYTES = 512 << 20
ARCHIVES = ("zip", "bz2")
MAX_COORDINATE_M = 1e8
"""Coordinates of every map projection are smaller."""
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
    with np.errstate(all="ignore"):  # trimesh divides by areas and volumes that may be zero, and needs no quotient
        _clean(path, mesh)
    vertices_m, faces = _subdivide(np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces), float(mesh.area))
    scene = texture(path.stem, (vertices_m, faces), 0.5, rng)
    return Scene(scene.name, vertices_m, faces, scene.reflectivity, scene.grain, bool(mesh.is_watertight))


def _clean(path: Path, mesh: "trimesh.Trimesh") -> None:
    """Merge equal vertices, remove faces without an area, and turn the others alike, outwards where that is known."""
    mesh.remove_unreferenced_vertices()
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces())
    if not len(mesh.faces):
        raise AsfmError(f"{path}: expected a mesh with faces, found only faces without an area")
    mesh.remove_unreferenced_vertices()
    mesh.fix_normals()


def _load(path: Path) -> "trimesh.Trimesh":
    """Load a mesh file, whose faces are not yet checked."""
    import trimesh

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else a traceback is printed before the message
    content, kind = _read_content(path)
    try:
        options = {"skip_materials": True} if kind == "obj" else {}
        source, resolver = io.BytesIO(content), FolderResolver(path.parent)
        mesh = trimesh.load(source, file_type=kind, resolver=resolver, force="mesh", process=False, **options)
    except AsfmError as error:
        raise AsfmError(f"{path}: cannot read a mesh: {error}") from None
    except (ImportError, LookupError, TypeError, AttributeError, AssertionError, NameError, struct.error):
        # These exceptions of a format's reader describe its code, not the file.
        raise AsfmError(f"{path}: cannot read a mesh: the file is damaged, or not what its suffix says") from None
    except Exception as error:  # trimesh passes on the exceptions of a dozen formats
        raise AsfmError(f"{path}: cannot read a mesh: {shorten(str(error)) or type(error).__name__}") from None
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise AsfmError(f"{path}: expected a mesh with faces, found none")
    return mesh


def _read_content(path: Path) -> tuple[bytes, str]:
    """Return the bytes of a mesh file and its format, by its suffix."""
    import trimesh

    check_file(path, "a mesh file", MAX_BYTES)
    kind = path.suffix.lower().removeprefix(".")
    if kind not in trimesh.available_formats():
        suffix = shorten(path.suffix) or "no suffix"
        raise AsfmError(f"{path}: expected a mesh such as .obj, .ply, .stl or .glb, found {suffix}")
    content = read_file(path, "a mesh file", MAX_BYTES)
    found = name_kind(content[:SNIFFED_BYTES])
    if found is not None and kind not in ARCHIVES:
        raise AsfmError(f"{path}: expected a mesh file, found {found}")
    if kind in ARCHIVES and not _unpacks_within(content, kind, MAX_BYTES):
        raise AsfmError(f"{path}: expected an archive of {MAX_BYTES} bytes at most, found more: unpack the mesh")
    return content, kind


def _unpacks_within(content: bytes, kind: str, limit: int) -> bool:
    """Return whether an archive holds at most so many bytes; a damaged one is left to its reader."""
    try:
        if kind == "zip":
            with zipfile.ZipFile(io.BytesIO(content)) as archive:
                return sum(entry.file_size for entry in archive.infolist()) <= limit
        with bz2.open(io.BytesIO(content)) as file:
            return sum(map(len, iter(partial(file.read, 1 << 20), b""))) <= limit
    except (OSError, EOFError, ValueError, zipfile.BadZipFile):
        return True


def _check_extent(path: Path, mesh: "trimesh.Trimesh") -> None:
    """Check that the faces refer to finite vertices within MAX_SIZE_M."""
    faces = np.asarray(mesh.faces)
    if faces.ndim != 2 or faces.shape[1] != 3 or np.shape(mesh.vertices)[1:] != (3,):
        raise AsfmError(f"{path}: expected triangles of vertices x y z, found other numbers of coordinates")
    if faces.min() < 0 or faces.max() >= len(mesh.vertices):
        raise AsfmError(f"{path}: expected faces among {len(mesh.vertices)} vertices, found number {faces.max()}")
    vertices_m = np.asarray(mesh.vertices, dtype=float)
    corners = vertices_m[faces].reshape(-1, 3)
    if not np.isfinite(corners).all():
        raise AsfmError(f"{path}: expected finite vertices, found NaN or infinity in the mesh")
    with np.errstate(over="ignore"):
        size_m = float(np.ptp(corners, axis=0).max())
    if size_m > MAX_SIZE_M:
        raise AsfmError(f"{path}: expected a mesh in metres, {MAX_SIZE_M:g} m across at most, found {size_m:.3g} m")
    away_m = float(np.abs(corners).max())
    if away_m > MAX_COORDINATE_M:
        raise AsfmError(f"{path}: expected coordinates of {MAX_COORDINATE_M:g} m at most, found {away_m:.3g} m")


def _subdivide(vertices_m: FloatArray, faces: IntArray, area_m2: float) -> tuple[FloatArray, IntArray]:
    """Subdivide faces until no edge is longer than FACE_EDGE_M, or longer for a mesh of more than MAX_FACES."""
    from trimesh.remesh import subdivide_to_size

    edge_m = max(FACE_EDGE_M, 3.5 * (area_m2 / MAX_FACES) ** 0.5)
    if len(faces) > MAX_FACES:
        return vertices_m, faces
    if count_quarters(vertices_m, faces, edge_m) > 2 * MAX_FACES:  # long and narrow faces
        return cut_long_faces(vertices_m, faces, edge_m, MAX_FACES)
    fine_m, fine_faces = subdivide_to_size(vertices_m, faces, edge_m, max_iter=20)
    return np.asarray(fine_m, dtype=float), np.asarray(fine_faces, dtype=np.int64)
