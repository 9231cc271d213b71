"""Scenes from mesh files, and files that are refused."""

import io
import json
import logging
from pathlib import Path

import numpy as np
import pytest
import trimesh

from asfm.errors import AsfmError
from asfm.simulation.scenes.mesh_file import read_mesh
from asfm.simulation.simulate import simulate


def _save(mesh: trimesh.Trimesh, path: Path) -> str:
    mesh.export(path)
    return str(path)


def test_mesh_file_is_read_as_a_scene(tmp_path: Path) -> None:
    box = trimesh.creation.box(extents=(2.0, 1.0, 1.0))
    simulated = simulate(_save(box, tmp_path / "crate.obj"), frame_count=20)
    assert simulated.scene.name == "crate"
    assert simulated.sequence.diagnostics == ()
    assert len(simulated.scene.faces) > 500  # subdivided to carry texture
    assert np.isfinite(simulated.read_truth(0).elevation_rad).any()


def test_mesh_far_from_the_origin_is_rendered_with_the_same_precision(tmp_path: Path) -> None:
    """Coordinates of a survey grid (hundreds of kilometres) do not coarsen the image."""
    box = trimesh.creation.box(extents=(2.0, 1.0, 1.0))
    here = simulate(_save(box, tmp_path / "here.ply"), frame_count=2)
    box.apply_translation([500_000.0, 4_000_000.0, -10.0])
    there = simulate(_save(box, tmp_path / "there.obj"), frame_count=2)
    seen = [np.isfinite(simulated.read_truth(1).elevation_rad).mean() for simulated in (here, there)]
    assert seen[0] > 0.01 and seen[1] == pytest.approx(seen[0], rel=0.05)


def test_open_mesh_is_simulated_with_a_diagnostic(tmp_path: Path) -> None:
    sheet = trimesh.Trimesh([[0, -3, 0], [0, 3, 0], [0, 0, 3]], [[0, 1, 2]])
    simulated = simulate(_save(sheet, tmp_path / "sheet.stl"), frame_count=3)
    opened = [found for found in simulated.sequence.diagnostics if found.code == "open-mesh"]
    assert len(opened) == 1 and "sheet is open" in opened[0].message
    assert np.isfinite(simulated.read_truth(1).elevation_rad).any()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("none.obj", None, "none.obj: expected a mesh file, found none"),
        ("empty.obj", b"", "empty.obj: "),
        ("words.stl", b"solid nothing of the kind", "words.stl: "),
        ("bytes.glb", b"\x00\x01\x02\x03" * 9, "bytes.glb: cannot read a mesh"),
        ("notes.txt", b"hello", "notes.txt: expected a mesh such as .obj, .ply, .stl or .glb, found .txt"),
        ("bare", b"hello", "bare: expected a mesh such as .obj, .ply, .stl or .glb, found no suffix"),
        ("point.obj", b"v 0 0 0\n", "point.obj: "),
        ("nan.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "nan.obj: expected finite vertices"),
        ("line.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "line.obj: .* found only faces without an area"),
        ("index.obj", b"v 0 0 0\nv 1 0 0\nv 2 1 0\nf 1 2 9\n", "index.obj: cannot read a mesh"),
        (
            "vast.obj",
            b"v 1e300 0 0\nv -1e300 0 0\nv 0 1e300 0\nf 1 2 3\n",
            r"metres, 100000 m across at most, found 2e\+300",
        ),
        (
            "short.stl",
            trimesh.creation.box().export(file_type="stl")[:300],
            "short.stl: cannot read a mesh: the file is",
        ),
        ("short.ply", trimesh.creation.box().export(file_type="ply")[:300], "short.ply: cannot read a mesh"),
        ("short.glb", trimesh.creation.box().export(file_type="glb")[:200], "short.glb: cannot read a mesh"),
    ],
)
def test_invalid_mesh_file_is_one_line_with_file_and_cause(
    tmp_path: Path, name: str, content: bytes | None, message: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(AsfmError, match=message) as caught:
        simulate(str(tmp_path / name))
    assert "\n" not in str(caught.value)


def test_a_damaged_mesh_is_refused_without_output_of_the_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What nobody handles is printed by Python; pytest has handlers of its own."""
    path, printed = tmp_path / "short.stl", io.StringIO()
    path.write_bytes(b"solid x" + bytes(73) + b"\xff\xff\xff\x0f" + bytes(100))
    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    monkeypatch.setattr(logging, "lastResort", logging.StreamHandler(printed))
    logging.getLogger("anything").warning("printed")
    with pytest.raises(AsfmError, match=r"short\.stl: "):
        simulate(str(path))
    assert printed.getvalue() == "printed\n"


def test_a_closed_mesh_without_a_volume_is_read_without_a_warning(
    tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    """Two layers of one sheet, joined all around."""
    path = tmp_path / "flat.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\nf 3 2 1\nf 4 3 1\n")
    scene = read_mesh(path, np.random.default_rng(0))
    assert len(scene.faces) and len(recwarn) == 0


def test_an_error_in_the_code_of_trimesh_is_not_quoted(tmp_path: Path) -> None:
    """Here a variable of the reader that was never set."""
    primitive = {"attributes": {"POSITION": 0}}
    content = {
        "asset": {"version": "2.0"},
        "accessors": [{"componentType": 5126, "count": 10**11, "type": "VEC3"}],
        "meshes": [{"primitives": [primitive]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    path = tmp_path / "x.gltf"
    path.write_text(json.dumps(content))
    with pytest.raises(AsfmError, match="cannot read a mesh: the file is damaged"):
        read_mesh(path, np.random.default_rng(0))
