"""points.ply: the landmarks as a point cloud in binary PLY format."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asfm.errors import AsfmError
from asfm.regular_file import read_file
from asfm.results.output_file import require_finite, write_file
from asfm.types import BoolArray, FloatArray, IntArray, Landmarks

PROPERTIES = {
    "x": ("<f8", "double"),
    "y": ("<f8", "double"),
    "z": ("<f8", "double"),
    "sigma_m": ("<f4", "float"),
    "views": ("<i4", "int"),
    "well_constrained": ("u1", "uchar"),
}
"""Name, NumPy and PLY type of every property of a point."""
MAX_VALUE_M = 1e12
VERTEX = np.dtype([(name, kind) for name, (kind, _) in PROPERTIES.items()])


@dataclass(frozen=True)
class Points:
    """The points of a run as its file holds them."""

    xyz_m: FloatArray
    """(L, 3) in the world frame."""
    sigma_m: FloatArray
    """(L,) largest standard deviation."""
    views: IntArray
    """(L,) number of frames that observe the landmark."""
    well_constrained: BoolArray
    """(L,) false where the motion does not determine the elevation."""


def write_points(path: Path, landmarks: Landmarks) -> None:
    """Write landmarks as binary little-endian PLY: x y z sigma_m (metres), views, well_constrained (1 or 0).

    Raises:
        AsfmError: the file cannot be written.
        ValueError: a coordinate or sigma is not finite: a defect of the caller.
    """
    require_finite("landmarks", landmarks.xyz_m, landmarks.sigma_m)
    vertices = np.empty(len(landmarks), dtype=VERTEX)
    for name, values in zip("xyz", landmarks.xyz_m.T, strict=True):
        vertices[name] = values
    for name in ("sigma_m", "views", "well_constrained"):
        vertices[name] = getattr(landmarks, name)
    write_file(path, _make_header(len(landmarks)) + vertices.tobytes())


def read_points(path: Path) -> Points:
    """Read the points of a run, in the file's order.

    Raises:
        AsfmError: the file cannot be read, or is not one that asfm wrote.
    """
    data = read_file(path, "the points of asfm run")
    end = data.find(b"end_header\n") + len(b"end_header\n")
    count, left_over = divmod(len(data) - end, VERTEX.itemsize)
    if left_over or data[:end] != _make_header(count):
        raise AsfmError(f"{path}: expected the points of asfm run, found another or a damaged file; run asfm run again")
    vertices = np.frombuffer(data, VERTEX, offset=end)
    for name in ("x", "y", "z", "sigma_m"):
        for row in np.flatnonzero(~(np.abs(vertices[name]) <= MAX_VALUE_M))[:1]:
            raise AsfmError(f"{path}, point {row}: expected a finite {name} in metres, found {vertices[name][row]:g}")
    return Points(
        xyz_m=np.stack([vertices[name] for name in "xyz"], axis=1),
        sigma_m=vertices["sigma_m"].astype(float),
        views=vertices["views"].astype(np.int64),
        well_constrained=vertices["well_constrained"] != 0,
    )


def _make_header(count: int) -> bytes:
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment asfm landmarks in metres; well_constrained 0 marks points whose elevation is not known",
        f"element vertex {count}",
        *(f"property {kind} {name}" for name, (_, kind) in PROPERTIES.items()),
        "end_header",
        "",
    ]
    return "\n".join(header).encode()
