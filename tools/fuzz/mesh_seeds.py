"""Fuzz targets of mesh files in the formats of trimesh."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from asfm.simulation.scenes.mesh_file import read_mesh
from tools.fuzz.cases import Target

FORMATS: dict[str, tuple[str, dict[str, object]]] = {
    "mesh.obj": ("m.obj", {}),
    "mesh.off": ("m.off", {}),
    "mesh.ply": ("m.ply", {}),
    "ascii mesh.ply": ("m.ply", {"encoding": "ascii"}),
    "mesh.stl": ("m.stl", {}),
    "ascii mesh.stl": ("m.stl", {"file_type": "stl_ascii"}),
    "mesh.glb": ("m.glb", {}),
    "mesh.gltf": ("m.gltf", {"merge_buffers": True}),
}
"""File name and options of trimesh for each target."""


def _make(name: str, options: dict[str, object]) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        from trimesh.creation import box
        from trimesh.exchange.gltf import export_gltf

        folder.mkdir(parents=True, exist_ok=True)
        mesh = box((0.3, 0.2, 0.1))
        if name.endswith(".gltf"):
            for file, content in export_gltf(mesh.scene(), merge_buffers=True).items():
                (folder / (name if file.endswith(".gltf") else file)).write_bytes(content)
        else:
            mesh.export(folder / name, **options)

    return make


def _reader(name: str) -> Callable[[Path], object]:
    return lambda folder: read_mesh(folder / name, np.random.default_rng(0))


MESH_TARGETS = {name: Target(file, _make(file, options), _reader(file)) for name, (file, options) in FORMATS.items()}
