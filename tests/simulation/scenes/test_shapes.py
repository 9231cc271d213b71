"""Mesh primitives: closed and wound outward with the volumes of their bodies, and random fields of unit variance."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from asfm.simulation.scenes.shapes import (
    Mesh,
    join_meshes,
    make_ball,
    make_box,
    make_ground,
    make_pipe,
    make_rock,
    make_sheet,
    move_mesh,
    texture,
    wave_field,
)


def _volume_m3(mesh: Mesh) -> float:
    """Compute the signed volume by the divergence theorem: positive where faces are wound outward."""
    a, b, c = np.moveaxis(mesh[0][mesh[1]], 1, 0)
    return float(np.sum(a * np.cross(b, c)) / 6)


def _make_pipe(radius_m: float) -> Mesh:
    return make_pipe(np.array([[0.0, 0, 0], [0, 0, 2.0]]), radius_m, np.random.default_rng(0), step_m=0.01)


@pytest.mark.parametrize(
    ("mesh", "volume_m3"),
    [
        (make_ball(0.7), 4 / 3 * np.pi * 0.7**3),
        (make_box((0.5, 0.8, 1.1)), 0.5 * 0.8 * 1.1),
        (_make_pipe(0.2), np.pi * 0.2**2 * 2.0),
    ],
    ids=["ball", "box", "pipe"],
)
def test_bodies_are_closed_and_wound_outward(mesh: Mesh, volume_m3: float) -> None:
    assert _volume_m3(mesh) == pytest.approx(volume_m3, rel=0.02)
    closed = trimesh.Trimesh(np.round(mesh[0], 9), mesh[1], process=True)
    assert closed.is_winding_consistent


@pytest.mark.parametrize("seed", range(4))
def test_rocks_are_closed_wound_outward_and_about_as_large_as_requested(seed: int) -> None:
    vertices_m, faces = make_rock(0.5, np.random.default_rng(seed))
    rock = trimesh.Trimesh(vertices_m, faces)
    assert rock.is_watertight and rock.volume > 0
    assert 0.25 < np.linalg.norm(vertices_m, axis=1).mean() < 0.75


def test_sheet_faces_up_and_has_the_requested_size() -> None:
    vertices_m, faces = make_sheet((2.0, 3.0), 0.1)
    a, b, c = np.moveaxis(vertices_m[faces], 1, 0)
    normal = np.cross(b - a, c - a)
    assert (normal[:, 2] > 0).all() and np.abs(normal[:, :2]).max() == 0
    assert normal[:, 2].sum() / 2 == pytest.approx(6.0)
    np.testing.assert_allclose(np.ptp(vertices_m, axis=0), [2.0, 3.0, 0.0])


def test_ground_has_the_requested_swell() -> None:
    heights_m = [make_ground((20.0, 20.0), np.random.default_rng(seed), 0.2, 0.2)[0][:, 2] for seed in range(20)]
    assert np.sqrt(np.mean(np.square(heights_m))) == pytest.approx(0.2, rel=0.15)


def test_wave_field_has_unit_variance_and_is_smooth_over_its_shortest_wavelength() -> None:
    points_m = np.stack([np.linspace(0, 500, 20_001), np.zeros(20_001)], axis=1)
    values = np.stack([wave_field(points_m, (2.0, 8.0), np.random.default_rng(seed)) for seed in range(30)])
    assert values.std() == pytest.approx(1.0, rel=0.05)
    assert np.abs(np.diff(values)).max() < 0.2 * np.pi * np.abs(values).max()


def test_mesh_is_rotated_by_yaw_pitch_and_roll_then_translated() -> None:
    mesh, turn_rad = make_box((1.0, 2.0, 3.0), 0.5), (0.3, -0.2, 0.5)
    moved_m, faces = move_mesh(mesh, (1.0, 2.0, 3.0), turn_rad)
    expected_m = Rotation.from_euler("ZYX", turn_rad).apply(mesh[0]) + np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(moved_m, expected_m, atol=1e-12)
    np.testing.assert_array_equal(faces, mesh[1])


def test_joined_meshes_keep_their_corners() -> None:
    meshes = [make_ball(0.3, 1), make_box((1.0, 1.0, 1.0), 0.5)]
    vertices_m, faces = join_meshes(meshes)
    np.testing.assert_array_equal(vertices_m[faces], np.concatenate([part[0][part[1]] for part in meshes]))


def test_texture_is_positive_with_a_mean_near_its_level() -> None:
    mesh = make_sheet((6.0, 6.0), 0.05)
    levels = [texture("sheet", mesh, 0.4, np.random.default_rng(seed)).reflectivity for seed in range(5)]
    assert np.min(levels) > 0 and np.mean(levels) == pytest.approx(0.4, rel=0.1) and np.std(levels) > 0.1
