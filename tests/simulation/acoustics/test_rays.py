"""Ray casting: the fan of rays, first hits against a brute-force intersection, incidence, and specular bounces."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.errors import AsfmError
from asfm.geometry.poses import make_pose
from asfm.geometry.sonar import SonarModel, project
from asfm.simulation.acoustics.rays import Hits, RayCaster, compute_incidence, make_ray_fan
from asfm.simulation.scenes.scene import Scene
from asfm.types import FloatArray, IntArray

EYE = np.eye(4)
RAYS_PER_BEAM = 200
SONAR = SonarModel.evenly_spaced("test", (0.5, 8.0), (-0.6, 0.6), (100, 24), 0.3)
FAN = make_ray_fan(SONAR, RAYS_PER_BEAM)


def make_scene(vertices_m: FloatArray, faces: IntArray) -> Scene:
    return Scene("test", vertices_m, faces, np.ones(len(faces)))


def make_triangles(count: int, centre_m: FloatArray) -> Scene:
    rng = np.random.default_rng(4)
    corners_m = rng.uniform(-3, 3, (count, 1, 3)) + rng.normal(0, 0.8, (count, 3, 3)) + centre_m
    return make_scene(corners_m.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def intersect(scene: Scene, origin_m: FloatArray, direction: FloatArray, max_range_m: float) -> tuple[FloatArray, ...]:
    """Intersect (N, 3) rays with every face by Cramer's rule: (N,) range and face of the first hit, else -1."""
    a, b, c = (scene.vertices_m[scene.faces[:, corner]] for corner in range(3))
    matrix = np.stack(np.broadcast_arrays(-direction[:, None], (b - a)[None], (c - a)[None]), axis=-1)
    with np.errstate(all="ignore"):
        range_m, u, v = np.moveaxis(np.linalg.solve(matrix, (origin_m[:, None] - a)[..., None])[..., 0], -1, 0)
    hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (range_m > 0) & (range_m < max_range_m)
    range_m = np.where(hit, range_m, np.inf)
    face = np.where(hit.any(axis=1), range_m.argmin(axis=1), -1)
    return np.minimum(range_m.min(axis=1), max_range_m), face


def test_rays_are_unit_vectors_inside_their_beam_and_the_aperture() -> None:
    assert FAN.direction.shape == (3, 24 * RAYS_PER_BEAM)
    np.testing.assert_allclose(np.linalg.norm(FAN.direction, axis=0), 1, atol=1e-6)
    _, bearing_rad, elevation_rad = project(FAN.direction.T.astype(float))
    np.testing.assert_array_equal(np.searchsorted(SONAR.bearing_edges_rad, bearing_rad) - 1, FAN.column)
    np.testing.assert_allclose(elevation_rad, FAN.elevation_rad, atol=1e-6)
    assert np.abs(elevation_rad).max() <= 0.15
    assert np.bincount(FAN.column).tolist() == [RAYS_PER_BEAM] * 24


def test_solid_angles_sum_to_that_of_the_field_of_view() -> None:
    assert FAN.solid_angle_sr.sum() == pytest.approx(1.2 * 2 * np.sin(0.15), rel=1e-4)


def test_rays_of_a_beam_are_spread_evenly_in_both_directions() -> None:
    """In every beam the empirical distribution across and along deviates little from the uniform one."""
    _, bearing_rad, elevation_rad = project(FAN.direction.T.astype(float))
    edges = SONAR.bearing_edges_rad
    across = (bearing_rad - edges[FAN.column]) / np.diff(edges)[FAN.column]
    along = elevation_rad / 0.3 + 0.5
    uniform = (np.arange(RAYS_PER_BEAM) + 0.5) / RAYS_PER_BEAM
    for share in (across, along):
        assert np.abs(np.sort(share.reshape(24, -1), axis=1) - uniform).max() < 0.015
    assert np.abs(np.corrcoef(across, along)[0, 1]) < 0.02


@pytest.mark.parametrize("centre_m", [np.zeros(3), np.array([4e5, -3e6, 20.0])])
def test_first_hits_are_those_of_a_brute_force_intersection(centre_m: FloatArray) -> None:
    scene = make_triangles(30, centre_m)
    pose = make_pose(np.array([-5.0, 0.5, 0.3]) + centre_m, Rotation.from_euler("ZYX", [0.1, 0.05, 0.4]))
    hits = RayCaster(scene).cast(pose, FAN.direction, 8.0)
    direction = FAN.direction.T @ pose[:3, :3].T
    range_m, face = intersect(scene, np.tile(pose[:3, 3], (len(direction), 1)), direction, 8.0)
    assert 0.2 < np.mean(face >= 0) < 0.95
    same = hits.face == face
    assert same.mean() > 0.998  # rays that graze an edge differ by rounding
    np.testing.assert_allclose(hits.range_m[same], range_m[same], atol=2e-4)
    assert (hits.range_m[hits.face < 0] == 8.0).all() and (hits.normal[:, hits.face < 0] == 0).all()
    np.testing.assert_allclose(hits.direction.T, direction, atol=1e-6)
    np.testing.assert_allclose(hits.up, pose[:3, 2], atol=1e-6)


def test_incidence_is_the_cosine_with_the_outward_normal() -> None:
    scene = make_triangles(30, np.zeros(3))
    pose = make_pose(np.array([-5.0, 0.5, 0.3]), Rotation.from_euler("ZYX", [0.1, 0.05, 0.4]))
    hits = RayCaster(scene).cast(pose, FAN.direction, 8.0)
    cos_incidence, cos_up = compute_incidence(hits)
    a, b, c = (scene.vertices_m[scene.faces[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    seen = hits.face >= 0
    expected = np.sum(normal[hits.face[seen]] * (FAN.direction.T @ pose[:3, :3].T)[seen], axis=1)
    np.testing.assert_allclose(cos_incidence[seen], expected, atol=1e-4)
    np.testing.assert_allclose(cos_up[seen], normal[hits.face[seen]] @ pose[:3, 2], atol=1e-4)
    np.testing.assert_array_equal(hits.cos_incidence, cos_incidence)
    assert (cos_incidence[~seen] == 0).all() and (cos_incidence[seen] < 0).any() and (cos_incidence[seen] > 0).any()


def make_corner() -> Scene:
    """A mirror at 45 degrees across the x axis at x = 3, and a wall at y = 2 that faces it."""
    mirror = np.array([[2.0, -1, -9], [4, 1, -9], [4, 1, 9], [2, -1, 9]])
    wall = np.array([[-9.0, 2, -9], [9, 2, -9], [9, 2, 9], [-9, 2, 9]])
    return make_scene(np.concatenate([mirror, wall]), np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]))


def test_bounce_has_the_range_of_the_mirrored_wall() -> None:
    """The mirror swaps x - 3 and y: the wall y = 2 appears at x = 5, so that the range is 5 / direction_x."""
    caster = RayCaster(make_corner())
    first = caster.cast(EYE, FAN.direction, 20.0)
    second = caster.bounce(first, 20.0)
    mirrored = (first.face == 0) | (first.face == 1)
    assert mirrored.sum() > 1000
    reached = mirrored & (second.face >= 2)
    assert reached.sum() > 0.9 * mirrored.sum()
    np.testing.assert_allclose(second.range_m[reached], 5.0 / FAN.direction[0, reached], atol=3e-3)
    np.testing.assert_allclose(second.direction[:, reached], FAN.direction[[1, 0, 2]][:, reached], atol=1e-5)
    ends_m = second.origin_m + second.range_m * second.direction  # relative to the centre of the scene
    np.testing.assert_allclose((ends_m.T + caster.centre_m)[reached, 1], 2.0, atol=3e-3)


def test_rays_without_a_first_or_second_hit_have_no_bounce() -> None:
    mirror_only = make_scene(np.array([[3.0, -1, -1], [3, 1, -1], [3, 0, 1]]), np.array([[0, 2, 1]]))
    caster = RayCaster(mirror_only)
    first = caster.cast(EYE, FAN.direction, 9.0)
    assert 0 < np.mean(first.face >= 0) < 1
    second = caster.bounce(first, 9.0)
    assert (second.face == -1).all() and (second.range_m == 9.0).all()


@pytest.mark.parametrize("beams", [slice(0, 1), slice(5, 9), slice(20, 24)])
def test_parts_of_a_fan_and_its_hits_belong_together(beams: slice) -> None:
    rays = slice(beams.start * RAYS_PER_BEAM, beams.stop * RAYS_PER_BEAM)
    caster = RayCaster(make_corner())
    whole, part = caster.cast(EYE, FAN.direction, 20.0), FAN.part(rays, beams.start)
    assert part.column.min() == 0 and part.column.max() == beams.stop - beams.start - 1
    cut = caster.cast(EYE, part.direction, 20.0)
    for hits in (whole, caster.bounce(whole, 20.0)):
        selected = hits.part(rays)
        assert isinstance(selected, Hits) and selected.direction.flags.c_contiguous
        np.testing.assert_array_equal(compute_incidence(selected)[0], hits.cos_incidence[rays])
    np.testing.assert_array_equal(cut.range_m, whole.range_m[rays])
    np.testing.assert_array_equal(cut.face, whole.face[rays])


def test_a_scene_without_faces_is_refused() -> None:
    with pytest.raises(AsfmError, match="scene test: expected a mesh with faces, found none"):
        RayCaster(make_scene(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)))
