"""Files beside a mesh: read from its folder only."""

from pathlib import Path

import pytest
import trimesh

from asfm.errors import AsfmError
from asfm.simulation.scenes.mesh_resolver import FolderResolver
from asfm.simulation.simulate import simulate


def test_files_beside_the_mesh_are_read_and_others_refused(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a.bin").write_bytes(b"abc")
    (tmp_path / "secret").write_bytes(b"abc")
    resolver = FolderResolver(tmp_path / "in")
    assert resolver.get("a.bin") == resolver["a.bin"] == resolver.namespaced("x").get("a.bin") == b"abc"
    assert resolver.keys() == []
    for name in ("../secret", str(tmp_path / "secret"), "gone"):
        with pytest.raises(AsfmError, match="a part of the mesh"):
            resolver.get(name)


def test_gltf_with_its_buffers_is_read(tmp_path: Path) -> None:
    for name, content in trimesh.Scene(trimesh.creation.box()).export(file_type="gltf").items():
        (tmp_path / name).write_bytes(content)
    assert len(simulate(str(tmp_path / "model.gltf"), frame_count=1).scene.faces) > 500
