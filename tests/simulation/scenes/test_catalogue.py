"""Every scene can be travelled through by every sonar, and any mesh becomes one."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

from asfm.errors import AsfmError
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import project
from asfm.simulation.acoustics.rays import RayCaster, make_ray_fan
from asfm.simulation.placement_checks import check_outside, count_blind
from asfm.simulation.scenes.catalogue import SCENES
from asfm.simulation.scenes.mesh_file import read_mesh
from asfm.simulation.scenes.scene import Scene
from asfm.simulation.scenes.seafloor import make_seafloor
from asfm.simulation.simulate import simulate, simulate_path
from asfm.simulation.sonars.parameters import make_sonar_model
from asfm.simulation.sonars.presets import PRESETS
from asfm.simulation.vehicle.trajectories import MOTIONS, View
from asfm.types import FloatArray, Trajectory


def _place(*xyz: float) -> FloatArray:
    pose = np.eye(4)
    pose[:3, 3] = xyz
    return pose[None]


def _save(mesh: trimesh.Trimesh, path: Path) -> str:
    mesh.export(path)
    return str(path)


@pytest.mark.parametrize("name", SCENES)
def test_scene_winds_outward_and_is_seen_all_along_its_motion(name: str) -> None:
    simulated = simulate(name, frame_count=30, seed=2)
    scene, sequence = simulated.scene, simulated.sequence
    assert np.isfinite(scene.vertices_m).all() and scene.reflectivity.min() > 0
    assert scene.faces.min() >= 0 and scene.faces.max() < len(scene.vertices_m)
    assert sequence.diagnostics == ()
    for index in (0, 15, 29):
        truth = simulated.read_truth(index)
        assert np.isfinite(truth.elevation_rad).mean() > 0.08
        assert 0.1 < np.median(truth.clean[np.isfinite(truth.elevation_rad)]) < 0.8
    assert sequence.groundtruth is not None
    hits = simulated.renderer.cast(sequence.groundtruth.world_from_vehicle[0])
    seen = hits.face >= 0
    assert (hits.toward[seen] > 0).mean() < 0.02  # hardly a back side in view


@pytest.fixture(scope="module")
def hull() -> Scene:
    return SCENES["hull"].make(np.random.default_rng(0))


@pytest.mark.parametrize("preset", PRESETS)
def test_preset_sees_the_hull(preset: str, hull: Scene) -> None:
    sonar = PRESETS[preset]
    level = View((0.0, 0.0, 0.0), 1.2, -0.45, 0.6 * sonar.range_max)
    times_s = np.linspace(0.0, 0.2, 2)
    simulated = simulate_path(
        hull, sonar, Trajectory(times_s, MOTIONS["hover"](level, times_s, np.random.default_rng(0)))
    )
    frame, truth = simulated.sequence.read_frame(1), simulated.read_truth(1)
    assert frame.image.shape == (PRESETS[preset].range_bins, PRESETS[preset].azimuth_bins)
    assert np.isfinite(truth.elevation_rad).mean() > 0.08
    assert np.all(np.diff(simulated.sequence.sonar.bearing_rad) > 0)
    assert np.abs(simulated.sequence.sonar.bearing_rad + simulated.sequence.sonar.bearing_rad[::-1]).max() < 0.02


def test_mesh_file_becomes_a_scene(tmp_path: Path) -> None:
    box = trimesh.creation.box(extents=(2.0, 1.0, 1.0))
    simulated = simulate(_save(box, tmp_path / "crate.obj"), frame_count=20)
    assert simulated.scene.name == "crate"
    assert simulated.sequence.diagnostics == ()
    assert len(simulated.scene.faces) > 500  # cut up to carry texture
    assert np.isfinite(simulated.read_truth(0).elevation_rad).any()


def test_mesh_far_from_the_origin_is_seen_as_well(tmp_path: Path) -> None:
    """Coordinates of a survey grid, in hundreds of kilometres, are no reason for a coarser picture."""
    box = trimesh.creation.box(extents=(2.0, 1.0, 1.0))
    here = simulate(_save(box, tmp_path / "here.ply"), frame_count=2)
    box.apply_translation([500_000.0, 4_000_000.0, -10.0])
    there = simulate(_save(box, tmp_path / "there.obj"), frame_count=2)
    seen = [np.isfinite(simulated.read_truth(1).elevation_rad).mean() for simulated in (here, there)]
    assert seen[0] > 0.01 and seen[1] == pytest.approx(seen[0], rel=0.05)


@pytest.mark.parametrize("preset", ["didson", "oculus_m750d_low", "aris_3000"])
@pytest.mark.parametrize("name", SCENES)
def test_scene_is_large_enough_for_forty_seconds(name: str, preset: str) -> None:
    """Of its usual motion, in steps of two seconds: never inside anything, always something to see."""
    sonar, (scene, caster) = PRESETS[preset], _build(name)
    view = SCENES[name].look(sonar.range_max)
    poses = MOTIONS[SCENES[name].motion](view, np.arange(0.0, 41.0, 2.0), np.random.default_rng(1))
    check_outside(scene, caster, poses)
    fan = make_ray_fan(make_sonar_model(sonar), 24)
    assert count_blind(caster, fan, poses, (sonar.range_min, sonar.range_max)) == 0


@cache
def _build(name: str) -> tuple[Scene, RayCaster]:
    scene = SCENES[name].make(np.random.default_rng(1))
    return scene, RayCaster(scene)


@pytest.mark.parametrize("name", SCENES)
def test_sonar_inside_the_things_of_a_scene_is_refused(name: str) -> None:
    """Two centimetres below almost any face there is a thing, or the ground: thin plates and crossings are the rest."""
    rng, (scene, caster) = np.random.default_rng(3), _build(name)
    corners_m = scene.vertices_m[scene.faces[rng.integers(len(scene.faces), size=40)]]
    normal = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    inside_m = corners_m.mean(axis=1) - 0.02 * normal / np.linalg.norm(normal, axis=1, keepdims=True)
    refused = 0
    for x, y, z in inside_m:
        try:
            check_outside(scene, caster, _place(x, y, z))
        except AsfmError as error:
            refused += "is inside an object" in str(error)
    assert refused >= 37


def test_open_mesh_is_simulated_with_a_warning(tmp_path: Path) -> None:
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
def test_bad_mesh_is_one_clear_line(tmp_path: Path, name: str, content: bytes | None, message: str) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(AsfmError, match=message) as caught:
        simulate(str(tmp_path / name))
    assert "\n" not in str(caught.value)


def test_sonar_inside_an_object_is_refused(tmp_path: Path) -> None:
    file = _save(trimesh.creation.icosphere(radius=2.0), tmp_path / "ball.ply")
    scene = read_mesh(Path(file), np.random.default_rng(0))
    path = Trajectory(np.array([0.0, 0.2]), np.concatenate([_place(-5, 0, 0), _place(0.3, 0.2, 0.1)]))
    with pytest.raises(AsfmError, match=r"scene ball: at frame 1 the sonar at \(0.30, 0.20, 0.10\) m is inside"):
        simulate_path(scene, PRESETS["oculus_m750d_high"], path)


def test_sonar_under_the_ground_is_refused_and_beside_things_is_not() -> None:
    scene = make_seafloor(np.random.default_rng(1), size_m=(8.0, 8.0))
    caster = RayCaster(scene)
    check_outside(scene, caster, np.concatenate([_place(0, 0, 2.0), _place(2, 2, 1.5)]))
    with pytest.raises(AsfmError, match="inside an object"):
        check_outside(scene, caster, _place(0, 0, -1.0))


def test_nothing_in_view_is_a_valid_image_of_noise_and_a_warning() -> None:
    triangle = Scene("far", np.array([[90.0, 0, 0], [90, 1, 0], [90, 0, 1]]), np.array([[0, 2, 1]]), np.ones(1))
    sonar = PRESETS["oculus_m750d_high"]
    simulated = simulate_path(triangle, sonar, Trajectory(np.array([0.0, 0.2]), np.tile(np.eye(4), (2, 1, 1))))
    (found,) = simulated.sequence.diagnostics
    assert found.code == "empty-frames"
    assert found.message == "2 of 2 frames see nothing of far within 8.0 m; it is 1 m across"
    image, truth = simulated.sequence.read_frame(0).image, simulated.read_truth(0)
    assert image.mean() == pytest.approx(sonar.add_sigma * np.sqrt(np.pi / 2), rel=0.02)
    assert np.isnan(truth.elevation_rad).all() and truth.clean.max() == 0


VIEW = View((1.0, 2.0, 0.5), 0.7, 0.4, 4.8)
TIMES_S = np.linspace(0.0, 16.0, 81)


@pytest.mark.parametrize("name", MOTIONS)
def test_motion_is_smooth_and_keeps_the_target_in_view(name: str) -> None:
    poses = MOTIONS[name](VIEW, TIMES_S, np.random.default_rng(1))
    steps_m = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert steps_m.max() < 0.2 and np.abs(np.diff(steps_m)).max() < 0.03
    assert np.abs(poses[:, :3, :3] @ np.swapaxes(poses[:, :3, :3], 1, 2) - np.eye(3)).max() < 1e-12
    range_m, bearing_rad, _ = project(transform(invert(poses), np.array(VIEW.target_m)))
    assert np.abs(bearing_rad).max() < np.deg2rad(50) and range_m.max() < 8
    span_m = np.ptp(poses[:, :3, 3], axis=0)
    if name == "static":
        assert np.array_equal(poses, np.tile(poses[0], (81, 1, 1)))
    elif name == "planar":
        assert span_m[2] < 1e-9 and span_m[:2].max() > 0.3
        assert np.ptp(poses[:, 2, 2]) < 1e-12  # neither roll nor pitch changes
    else:
        assert span_m.max() > 0.3 and np.ptp(poses[:, 2, 2]) > 1e-4


def test_orbit_turns_about_the_target_and_revisit_comes_back() -> None:
    orbit = MOTIONS["orbit"](VIEW, TIMES_S, np.random.default_rng(1))
    turned_rad = np.arctan2(orbit[-1, 1, 0], orbit[-1, 0, 0]) - np.arctan2(orbit[0, 1, 0], orbit[0, 0, 0])
    assert turned_rad == pytest.approx(16 * 0.2 / 4.8, abs=0.15)
    places = MOTIONS["revisit"](VIEW, TIMES_S, np.random.default_rng(1))[:, :3, 3]
    from_start = np.linalg.norm(places - places[0], axis=1)
    assert from_start[30:50].min() > 0.6
    assert from_start[67:].min() < 0.35


def test_path_of_a_file_is_followed() -> None:
    from scipy.spatial.transform import Rotation

    angle = Rotation.from_euler("ZYX", [0.1, -0.5, 0.0])
    ends = make_pose(np.array([[-4.0, 0, -2.0], [-2.0, 0, -2.0]]), Rotation.concatenate([angle, angle]))
    simulated = simulate("hull", motion=Trajectory(np.array([10.0, 14.0]), ends), frame_count=80)
    truth = simulated.sequence.groundtruth
    assert truth is not None
    assert len(simulated.sequence) == 21  # 4 s at 5 Hz, not 80
    (found,) = [found for found in simulated.sequence.diagnostics if found.code == "short-path"]
    assert "after 21 of 80 frames at 5 Hz" in found.message
    assert truth.timestamps_s[[0, -1]] == pytest.approx([10.0, 14.0])
    assert truth.world_from_vehicle[10, :3, 3] == pytest.approx([-3.0, 0, -2.0])
