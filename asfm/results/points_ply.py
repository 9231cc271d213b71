"""points.ply: the landmarks as a point cloud in binary PLY format."""

from pathlib import Path
from typing import Any

import numpy as np

from asfm.results.output_file import require_finite, write_file
from asfm.types import Landmarks


def write_points(path: Path, landmarks: Landmarks) -> None:
    """Write landmarks as binary little-endian PLY: x y z sigma_m (metres), views, well_constrained (1 or 0).

    Raises:
        AsfmError: the file cannot be written.
        ValueError: a coordinate or sigma is not finite: a defect of the caller.
    """
    require_finite("landmarks", landmarks.xyz_m, landmarks.sigma_m)
    columns: dict[str, tuple[str, str, Any]] = {
        "x": ("<f8", "double", landmarks.xyz_m[:, 0]),
        "y": ("<f8", "double", landmarks.xyz_m[:, 1]),
        "z": ("<f8", "double", landmarks.xyz_m[:, 2]),
        "sigma_m": ("<f4", "float", landmarks.sigma_m),
        "views": ("<i4", "int", landmarks.views),
        "well_constrained": ("u1", "uchar", landmarks.well_constrained),
    }
    vertices = np.empty(len(landmarks), dtype=[(name, kind) for name, (kind, _, _) in columns.items()])
    for name, (_, _, values) in columns.items():
        vertices[name] = values
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment asfm landmarks in metres; well_constrained 0 marks points whose elevation is not known",
        f"element vertex {len(landmarks)}",
        *(f"property {kind} {name}" for name, (_, kind, _) in columns.items()),
        "end_header",
        "",
    ]
    write_file(path, "\n".join(header).encode() + vertices.tobytes())
