"""Triangulation against exact geometry, finite differences and an exhaustive grid search."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.estimation.triangulation import (
    CHUNK_OBSERVATIONS,
    Gate,
    _Observations,
    _refine,
    squared_residuals,
    triangulate_tracks,
    whitened_residuals,
)
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, back_project, project, project_jacobian
from asfm.types import FloatArray, IntArray, Tracks

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (500, 128), np.deg2rad(20))
GATE = Gate(SONAR.elevation_aperture_rad / 2, edge_rad=0.02)
SIGMA = np.array([0.01, 0.005])


def _poses(rng: np.random.Generator, count: int = 12) -> FloatArray:
    """Make 6-DoF poses near the origin that keep points ahead in view and roll by tens of degrees."""
    angle_rad = rng.uniform([-0.15, -0.04, -0.5], [0.15, 0.04, 0.5], (count, 3))
    return make_pose(rng.uniform(-0.4, 0.4, (count, 3)) * [1, 1, 0.3], Rotation.from_euler("ZYX", angle_rad))


def _points(rng: np.random.Generator, count: int) -> FloatArray:
    """Make points ahead of the poses."""
    spherical = rng.uniform([3, -0.3, -0.03], [8, 0.3, 0.03], (count, 3))
    return back_project(spherical[:, 0], spherical[:, 1], spherical[:, 2])


def _observe(world_from_sonar: FloatArray, xyz_m: FloatArray) -> Tracks:
    """Observe all points exactly by all frames that see them."""
    seen = transform(invert(world_from_sonar), xyz_m[:, None])
    track, frame = np.nonzero(SONAR.sees(seen))
    assert len(np.unique(track)) == len(xyz_m), "every point must be seen"
    range_m, bearing_rad, _ = project(seen[track, frame])
    return Tracks(track, frame, range_m, bearing_rad)


@pytest.mark.parametrize("scale", [0.1, 1.0, 30.0])
def test_projection_jacobian_agrees_with_finite_differences(scale: float) -> None:
    xyz_m = np.random.default_rng(0).normal(0, scale, (200, 3))
    step = 1e-6 * scale
    numerical = np.empty((200, 3, 3))
    for axis in range(3):
        offset = step * np.eye(3)[axis]
        ahead, behind = np.stack(project(xyz_m + offset), -1), np.stack(project(xyz_m - offset), -1)
        difference = ahead - behind
        difference[:, 1] = np.angle(np.exp(1j * difference[:, 1]))
        numerical[..., axis] = difference / (2 * step)
    worst = np.abs(numerical).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(project_jacobian(xyz_m) / worst, numerical / worst, atol=1e-6)


def test_exact_observations_give_exact_points() -> None:
    rng = np.random.default_rng(1)
    poses, xyz_m = _poses(rng), _points(rng, 300)
    tracks = _observe(poses, xyz_m)
    found = triangulate_tracks(tracks, poses, SONAR, np.tile(SIGMA, (len(tracks), 1)), GATE)
    error_m = np.linalg.norm(found.xyz_m - xyz_m, axis=1)
    views = np.bincount(tracks.track)
    assert (views >= 4).mean() > 0.9
    assert error_m[views >= 4].max() < 1e-3
    assert found.inlier.all()
    assert np.abs(found.residual).max() < 0.1


def test_points_move_with_the_world() -> None:
    """Points are equivariant under a rigid change of the world frame."""
    rng = np.random.default_rng(2)
    poses, xyz_m = _poses(rng), _points(rng, 60)
    tracks = _observe(poses, xyz_m)
    sigma = np.tile(SIGMA, (len(tracks), 1))
    noisy = Tracks(tracks.track, tracks.frame, tracks.range_m + rng.normal(0, 0.01, len(tracks)), tracks.bearing_rad)
    other = make_pose(np.array([10.0, -20.0, 5.0]), Rotation.from_euler("ZYX", [2.0, 0.5, -1.0]))
    here = triangulate_tracks(noisy, poses, SONAR, sigma, GATE)
    there = triangulate_tracks(noisy, other @ poses, SONAR, sigma, GATE)
    np.testing.assert_allclose(there.xyz_m, transform(other, here.xyz_m), atol=1e-6)
    np.testing.assert_array_equal(there.inlier, here.inlier)


def test_planted_outliers_are_found_and_do_not_move_the_points() -> None:
    rng = np.random.default_rng(3)
    poses, xyz_m = _poses(rng, 16), _points(rng, 150)
    exact = _observe(poses, xyz_m)
    wrong = rng.random(len(exact)) < 0.15
    range_m = exact.range_m + wrong * rng.choice([-1, 1], len(exact)) * rng.uniform(0.2, 1.0, len(exact))
    tracks = Tracks(exact.track, exact.frame, range_m, exact.bearing_rad)
    found = triangulate_tracks(tracks, poses, SONAR, np.tile(SIGMA, (len(tracks), 1)), GATE)
    right = np.bincount(exact.track, ~wrong) >= 6
    assert right.mean() > 0.9
    tested = right[exact.track]
    assert found.inlier[tested & wrong].mean() < 0.01
    assert found.inlier[tested & ~wrong].mean() > 0.99
    assert np.median(np.linalg.norm(found.xyz_m - xyz_m, axis=1)[right]) < 1e-3
    assert (np.linalg.norm(found.xyz_m - xyz_m, axis=1)[right] < 0.02).mean() > 0.97


def _exhaustive_cost(point: FloatArray, tracks: Tracks, rows: IntArray, poses: FloatArray) -> float:
    total = 0.0
    for row in rows.tolist():
        seen = np.linalg.solve(poses[tracks.frame[row]], np.append(point, 1.0))[:3]
        range_error = (np.linalg.norm(seen) - tracks.range_m[row]) / SIGMA[0]
        bearing_error = (np.arctan2(seen[1], seen[0]) - tracks.bearing_rad[row]) / SIGMA[1]
        total += min(range_error**2 + bearing_error**2, 9.0)
    return total


def test_cost_is_no_higher_than_that_of_an_exhaustive_grid_search() -> None:
    """The truncated cost at the points is at most that of the best of 41 points on every observation's arc.

    One track may end in another local minimum that is nearly as low; the sum of all must be lower.
    """
    rng = np.random.default_rng(4)
    poses, xyz_m = _poses(rng, 8), _points(rng, 8)
    exact = _observe(poses, xyz_m)
    noise = rng.normal(0, SIGMA, (len(exact), 2))
    tracks = Tracks(exact.track, exact.frame, exact.range_m + noise[:, 0], exact.bearing_rad + noise[:, 1])
    found = triangulate_tracks(tracks, poses, SONAR, np.tile(SIGMA, (len(tracks), 1)), GATE)
    costs, bests = [], []
    for index in range(len(xyz_m)):
        rows = np.flatnonzero(tracks.track == index)
        arcs = [
            transform(poses[tracks.frame[row]], SONAR.elevation_arc(tracks.range_m[row], tracks.bearing_rad[row], 41))
            for row in rows
        ]
        bests.append(min(_exhaustive_cost(point, tracks, rows, poses) for arc in arcs for point in arc))
        costs.append(_exhaustive_cost(found.xyz_m[index], tracks, rows, poses))
    assert np.all(np.array(costs) <= np.array(bests) + 3)
    assert np.sum(costs) < np.sum(bests)


def test_points_stay_in_the_beam_where_elevation_is_unobservable() -> None:
    """Without motion every elevation fits; the point must still lie on the arc."""
    rng = np.random.default_rng(5)
    poses = np.repeat(np.eye(4)[None], 5, axis=0)
    xyz_m = _points(rng, 30)
    tracks = _observe(poses, xyz_m)
    found = triangulate_tracks(tracks, poses, SONAR, np.tile(SIGMA, (len(tracks), 1)), GATE)
    range_m, bearing_rad, elevation_rad = project(found.xyz_m)
    np.testing.assert_allclose(range_m, project(xyz_m)[0], atol=0.01)
    np.testing.assert_allclose(bearing_rad, project(xyz_m)[1], atol=0.01)
    assert np.all(np.abs(elevation_rad) <= SONAR.elevation_aperture_rad / 2)
    assert found.inlier.all()


def test_tracks_are_independent_of_each_other() -> None:
    """With more observations than one chunk, each track gives the same point as alone."""
    rng = np.random.default_rng(6)
    poses, xyz_m = _poses(rng, 20), _points(rng, 1500)
    tracks = _observe(poses, xyz_m)
    assert len(tracks) > CHUNK_OBSERVATIONS
    found = triangulate_tracks(tracks, poses, SONAR, np.tile(SIGMA, (len(tracks), 1)), GATE, elevation_count=5)
    for index in (0, 700, 1499):
        rows = tracks.track == index
        alone = Tracks(np.zeros(rows.sum(), int), tracks.frame[rows], tracks.range_m[rows], tracks.bearing_rad[rows])
        single = triangulate_tracks(alone, poses, SONAR, np.tile(SIGMA, (len(alone), 1)), GATE, elevation_count=5)
        np.testing.assert_allclose(single.xyz_m[0], found.xyz_m[index], atol=1e-9)


def test_no_tracks_give_no_points() -> None:
    nothing = Tracks(np.zeros(0, int), np.zeros(0, int), np.zeros(0), np.zeros(0))
    found = triangulate_tracks(nothing, np.eye(4)[None], SONAR, np.zeros((0, 2)), GATE)
    assert found.xyz_m.shape == (0, 3) and found.inlier.shape == (0,) and found.residual.shape == (0, 2)


def test_residuals_are_in_sigmas_and_elevations_as_seen() -> None:
    rng = np.random.default_rng(7)
    poses, xyz_m = _poses(rng), _points(rng, 20)
    exact = _observe(poses, xyz_m)
    tracks = Tracks(exact.track, exact.frame, exact.range_m - 0.02, exact.bearing_rad + 0.01)
    sonar_from_world = invert(poses)[tracks.frame]
    residual, elevation_rad = whitened_residuals(xyz_m, tracks, sonar_from_world, np.tile(SIGMA, (len(tracks), 1)))
    np.testing.assert_allclose(residual, np.tile([2.0, -2.0], (len(tracks), 1)), atol=1e-9)
    seen = back_project(exact.range_m, exact.bearing_rad, elevation_rad)
    np.testing.assert_allclose(transform(poses[tracks.frame], seen), xyz_m[tracks.track], atol=1e-9)


def _one_track(poses: FloatArray, xyz_m: FloatArray) -> Tracks:
    """Let every frame observe one point, inside its field of view or not."""
    range_m, bearing_rad, _ = project(transform(invert(poses), xyz_m))
    return Tracks(np.zeros(len(poses), int), np.arange(len(poses)), range_m, bearing_rad)


def _rolled_poses(roll_rad: FloatArray) -> FloatArray:
    """Make poses at one place that differ in roll, which determines the elevation."""
    return make_pose(np.zeros((len(roll_rad), 3)), Rotation.from_rotvec(np.outer(roll_rad, [1.0, 0.0, 0.0])))


def test_a_few_gross_errors_do_not_choose_the_elevation() -> None:
    """Five views agree on a low point, two on a high one, kilometres of sigmas away: the majority decides.

    Without the truncation the sum of squares lies between the two, where no view agrees.
    """
    poses = _rolled_poses(np.linspace(-0.6, 0.6, 7))
    low, high = (back_project(np.array(5.0), np.array(0.1), elevation) for elevation in (-0.12, 0.12))
    tracks, other = _one_track(poses, low), _one_track(poses, high)
    wrong = np.isin(np.arange(7), [0, 6])
    mixed = Tracks(
        tracks.track,
        tracks.frame,
        np.where(wrong, 7.0, tracks.range_m),
        np.where(wrong, other.bearing_rad, tracks.bearing_rad),
    )
    found = triangulate_tracks(mixed, poses, SONAR, np.tile(SIGMA, (7, 1)), GATE)
    np.testing.assert_allclose(found.xyz_m[0], low, atol=0.02)
    np.testing.assert_array_equal(found.inlier, ~wrong)


@pytest.mark.parametrize("side", [-1, 1])
def test_observations_of_a_point_outside_their_aperture_are_outliers_at_its_distance_in_edge_sigmas(side: int) -> None:
    edge_rad = GATE.half_aperture_rad + np.array([-0.01, 2.5 * GATE.edge_rad])
    xyz_m = back_project(np.array([5.0, 5.0]), np.zeros(2), side * edge_rad)
    tracks = Tracks(np.array([0, 1]), np.array([0, 0]), np.full(2, 5.0), np.zeros(2))
    square, residual = squared_residuals(xyz_m, tracks, np.tile(np.eye(4), (2, 1, 1)), np.tile(SIGMA, (2, 1)), GATE)
    np.testing.assert_allclose(square, [0.0, 6.25], atol=1e-9)
    np.testing.assert_allclose(residual, 0.0, atol=1e-9)


def test_of_a_point_and_its_reflection_the_search_takes_the_one_inside_the_aperture_of_all_frames() -> None:
    """Sideways motion leaves the sign of the elevation open; of frames pitched in place one can only see one sign.

    Most frames see the reflection nearer to the middle of their beam: the weak prior alone would take it.
    """
    half = GATE.half_aperture_rad
    aside, in_place = np.linspace(-2.5, 2.5, 6), np.array([-0.28] * 10 + [1.43])
    y_m, pitch_rad = np.append(aside, np.zeros(11)), np.append(np.zeros(6), in_place * half)
    poses = make_pose(
        np.stack([0 * y_m, y_m, 0 * y_m], axis=1), Rotation.from_rotvec(np.outer(pitch_rad, [0.0, 1.0, 0.0]))
    )
    below = back_project(np.array(5.0), np.array(0.0), -0.7 * half)
    tracks = _one_track(poses, below)
    found = triangulate_tracks(tracks, poses, SONAR, np.tile(0.1 * SIGMA, (len(tracks), 1)), GATE)
    np.testing.assert_allclose(found.xyz_m[0], below, atol=0.01)
    assert found.inlier.all()


@pytest.mark.parametrize("elevation_count", [5, 21])
def test_points_are_at_the_optimum_over_all_their_inliers(elevation_count: int) -> None:
    """Another step of the refinement hardly moves them, although a coarse grid begins with few of the inliers."""
    rng = np.random.default_rng(8)
    poses, xyz_m = _poses(rng), _points(rng, 200)
    exact = _observe(poses, xyz_m)
    error = rng.normal(0, SIGMA, (len(exact), 2))
    tracks = Tracks(exact.track, exact.frame, exact.range_m + error[:, 0], exact.bearing_rad + error[:, 1])
    sigma, first = np.tile(SIGMA, (len(tracks), 1)), np.flatnonzero(np.diff(tracks.track, prepend=-1))
    found = triangulate_tracks(tracks, poses, SONAR, sigma, GATE, elevation_count)
    observations = _Observations(tracks, first, poses, invert(poses)[tracks.frame], sigma, GATE)
    step_m = np.linalg.norm(_refine(found.xyz_m, observations, found.inlier) - found.xyz_m, axis=1)
    assert np.quantile(step_m[np.bincount(tracks.track) >= 4], 0.9) < 1e-6
