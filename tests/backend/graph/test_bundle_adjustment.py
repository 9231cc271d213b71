"""Bundle adjustment on synthetic points: poses and points within their noise, and consistent covariances."""

from dataclasses import dataclass, replace

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.graph.aperture_bounds import add_aperture_priors
from asfm.backend.graph.bundle_adjustment import Bundle, adjust_bundle
from asfm.backend.graph.marginal_covariance import measure_uncertainty
from asfm.backend.graph.problem import FIRST_POINT, BundleProblem
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.types import FloatArray, Tracks

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (500, 128), np.deg2rad(20))
SIGMA = np.array([0.01, 0.005])
STEP_SIGMA = np.array([0.003, 0.02])
LEVER_ARM = make_pose(np.array([0.4, -0.1, -0.2]), Rotation.from_euler("ZYX", [0.1, 0.2, 0.0]))


def landmark_covariances(bundle: Bundle) -> FloatArray:
    return measure_uncertainty(bundle, np.ones(len(bundle.xyz_m))).point_m2


@dataclass(frozen=True)
class World:
    """A problem with its truth and initial values."""

    problem: BundleProblem
    poses: FloatArray
    xyz_m: FloatArray
    start_poses: FloatArray
    start_xyz_m: FloatArray


def make_world(seed: int, noise: float = 1.0, frame_count: int = 20, points: int = 60, drift: float = 1.0) -> World:
    """Random points ahead of a sonar that moves in six degrees of freedom; most points are in all frames.

    Args:
        noise: scale of the observations' errors; the stated sigmas do not change.
        drift: scale of the errors of the odometry.
    """
    rng = np.random.default_rng(seed)
    angle_rad = rng.uniform([-0.12, -0.03, -0.5], [0.12, 0.03, 0.5], (frame_count, 3))
    world_from_sonar = make_pose(
        rng.uniform([-0.4, -0.4, -0.15], [0.4, 0.4, 0.15], (frame_count, 3)), Rotation.from_euler("ZYX", angle_rad)
    )
    spherical = rng.uniform([3, -0.35, -0.06], [8, 0.35, 0.06], (points, 3))
    xyz_m = back_project(*spherical.T)
    poses = world_from_sonar @ invert(LEVER_ARM)
    seen = transform(invert(world_from_sonar), xyz_m[:, None])
    track, frame = np.nonzero(SONAR.sees(seen))
    range_m, bearing_rad, _ = project(seen[track, frame])
    error = noise * rng.normal(0, SIGMA, (len(track), 2))
    tracks = Tracks(track, frame, range_m + error[:, 0], bearing_rad + error[:, 1])
    wrong = drift * rng.normal(0, np.repeat(STEP_SIGMA, 3), (frame_count - 1, 6))
    steps = invert(poses[:-1]) @ poses[1:] @ make_pose(wrong[:, 3:], Rotation.from_rotvec(wrong[:, :3]))
    start = [poses[0]]
    for step in steps:
        start.append(start[-1] @ step)
    sensors = SensorConstraints(
        poses[0],
        np.full(6, 1e-6),
        True,
        steps,
        np.tile(STEP_SIGMA, (frame_count - 1, 1)),
        np.zeros((0, 3)),
        np.zeros((0, 3)),
    )
    problem = BundleProblem(
        tracks,
        np.ones(len(tracks), dtype=bool),
        np.tile(SIGMA, (len(tracks), 1)),
        sensors,
        LEVER_ARM,
        SONAR.elevation_aperture_rad / 2,
    )
    return World(problem, poses, xyz_m, np.stack(start), xyz_m + rng.normal(0, 0.05, xyz_m.shape))


def _solve(world: World) -> Bundle:
    return adjust_bundle(world.problem, world.start_poses, world.start_xyz_m)


def _position_error_m(poses: FloatArray, truth: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum((poses - truth)[:, :3, 3] ** 2, axis=1))))


def test_exact_measurements_give_the_true_poses_and_points() -> None:
    world = make_world(0, noise=0.0, drift=0.0, frame_count=10, points=40)
    rng = np.random.default_rng(1)
    wrong = make_pose(rng.normal(0, 0.03, (10, 3)), Rotation.from_rotvec(rng.normal(0, 0.01, (10, 3))))
    bundle = adjust_bundle(world.problem, world.poses @ wrong, world.start_xyz_m, relative_tolerance=1e-9)
    np.testing.assert_allclose(bundle.world_from_vehicle, world.poses, atol=1e-4)
    np.testing.assert_allclose(bundle.xyz_m, world.xyz_m, atol=1e-3)


@pytest.mark.parametrize("seed", [0, 1])
def test_noisy_observations_reduce_the_drift_of_odometry(seed: int) -> None:
    world = make_world(seed)
    bundle = _solve(world)
    before_m, after_m = (_position_error_m(p, world.poses) for p in (world.start_poses, bundle.world_from_vehicle))
    assert after_m < 0.35 * before_m
    turn_rad = Rotation.from_matrix((invert(world.poses) @ bundle.world_from_vehicle)[:, :3, :3]).magnitude()
    assert np.sqrt(np.mean(turn_rad**2)) < 0.01
    np.testing.assert_allclose(bundle.world_from_vehicle[0], world.poses[0], atol=1e-4)


def test_landmark_covariances_are_consistent() -> None:
    """The mean NEES of points under independent noise is near 3, their dimension."""
    squared = []
    for seed in range(4):
        world = make_world(seed, points=50)
        bundle = _solve(world)
        error_m = bundle.xyz_m - world.xyz_m
        covariance = landmark_covariances(bundle)
        np.testing.assert_allclose(covariance, np.swapaxes(covariance, 1, 2), atol=1e-12)
        squared.append(np.einsum("ti,tij,tj->t", error_m, np.linalg.inv(covariance), error_m))
    mean = float(np.mean(squared))
    assert 2.0 < mean < 4.5, f"mean NEES {mean:.2f}"


def test_covariances_scale_with_the_stated_noise() -> None:
    """Doubling all sigmas quadruples the covariances, up to the aperture prior."""
    world = make_world(5, noise=0.0, drift=0.0, frame_count=8, points=25)
    sensors = world.problem.sensors
    doubled = replace(
        world.problem,
        sigma=2 * world.problem.sigma,
        sensors=replace(sensors, step_sigma=2 * sensors.step_sigma, first_sigma=2 * sensors.first_sigma),
    )
    first, second = (
        landmark_covariances(adjust_bundle(problem, world.poses, world.xyz_m, relative_tolerance=1e-9))
        for problem in (world.problem, doubled)
    )
    np.testing.assert_allclose(second, 4 * first, rtol=5e-2, atol=1e-6)


def test_result_is_equivariant_to_a_rigid_motion_of_the_world() -> None:
    world = make_world(2, frame_count=10, points=40)
    other = make_pose(np.array([30.0, -10.0, 4.0]), Rotation.from_euler("ZYX", [2.0, 0.4, -0.7]))
    moved = replace(
        world,
        problem=replace(
            world.problem, sensors=replace(world.problem.sensors, first_pose=other @ world.problem.sensors.first_pose)
        ),
        start_poses=other @ world.start_poses,
        start_xyz_m=transform(other, world.start_xyz_m),
    )
    here, there = _solve(world), _solve(moved)
    np.testing.assert_allclose(there.world_from_vehicle, other @ here.world_from_vehicle, atol=1e-4)
    np.testing.assert_allclose(there.xyz_m, transform(other, here.xyz_m), atol=1e-3)


def test_gross_errors_change_poses_little() -> None:
    """Cauchy kernels: one observation in twenty is off by half a metre."""
    world = make_world(3)
    tracks = world.problem.tracks
    off_m = 0.5 * (np.random.default_rng(0).random(len(tracks)) < 0.05)
    corrupted = replace(world, problem=replace(world.problem, tracks=replace(tracks, range_m=tracks.range_m + off_m)))
    clean_m, corrupted_m = (_position_error_m(_solve(w).world_from_vehicle, world.poses) for w in (world, corrupted))
    assert corrupted_m < 1.5 * clean_m + 0.005


def test_points_stay_inside_the_aperture_without_motion() -> None:
    world = make_world(4, frame_count=6, points=25)
    still = np.repeat(world.poses[:1], 6, axis=0)
    seen = transform(invert(still @ LEVER_ARM), world.xyz_m[:, None])
    track, frame = world.problem.tracks.track, world.problem.tracks.frame
    range_m, bearing_rad, _ = project(seen[track, frame])
    sensors = replace(world.problem.sensors, steps=np.repeat(np.eye(4)[None], 5, axis=0))
    problem = replace(world.problem, tracks=Tracks(track, frame, range_m, bearing_rad), sensors=sensors)
    bundle = adjust_bundle(problem, still, world.start_xyz_m + np.array([0, 0, 2.0]))
    found_range_m, _, elevation_rad = project(transform(invert(still[0] @ LEVER_ARM), bundle.xyz_m[bundle.in_graph]))
    assert np.abs(elevation_rad).max() < SONAR.elevation_aperture_rad / 2 + 0.02
    np.testing.assert_allclose(bundle.world_from_vehicle, still, atol=5e-3)
    sigma_m = np.sqrt(np.linalg.eigvalsh(landmark_covariances(bundle)[bundle.in_graph])[:, -1])
    along_the_arc_m = found_range_m * SONAR.elevation_aperture_rad / 2 / np.sqrt(3)
    ratio = sigma_m / along_the_arc_m
    assert ratio.min() > 0.9, "the aperture is one piece of information, however often the bound was active"
    assert ratio.max() < 1.2


def test_navigation_determines_height_and_attitude() -> None:
    """Without a single observation the poses take height, roll and pitch from the sensors, the rest from odometry."""
    world = make_world(6, drift=1.0)
    angles = Rotation.from_matrix(world.poses[:, :3, :3]).as_euler("ZYX")
    readings = np.column_stack([world.poses[:, 2, 3], angles[:, 2], angles[:, 1]])
    sensors = replace(
        world.problem.sensors,
        z_roll_pitch=readings,
        z_roll_pitch_sigma=np.full(readings.shape, 1e-4),
        first_sigma=np.array([1e-2, 1e-2, 1e-6, 1e-6, 1e-6, 1e-1]),
    )
    blind = replace(world.problem, sensors=sensors, observed=np.zeros(len(world.problem.tracks), dtype=bool))
    bundle = adjust_bundle(blind, world.start_poses, world.start_xyz_m)
    found = Rotation.from_matrix(bundle.world_from_vehicle[:, :3, :3]).as_euler("ZYX")
    np.testing.assert_allclose(found[:, 1:], angles[:, 1:], atol=1e-3)
    np.testing.assert_allclose(bundle.world_from_vehicle[:, 2, 3], world.poses[:, 2, 3], atol=1e-3)
    assert not bundle.in_graph.any()
    np.testing.assert_array_equal(bundle.xyz_m, world.start_xyz_m)
    assert np.isinf(landmark_covariances(bundle)).all()


def test_points_without_observations_keep_their_position() -> None:
    world = make_world(7, frame_count=8, points=20)
    used = world.problem.tracks.track % 2 == 0
    bundle = adjust_bundle(replace(world.problem, observed=used), world.start_poses, world.start_xyz_m)
    np.testing.assert_array_equal(bundle.in_graph, np.arange(20) % 2 == 0)
    np.testing.assert_array_equal(bundle.xyz_m[1::2], world.start_xyz_m[1::2])
    assert np.isfinite(landmark_covariances(bundle)[::2]).all()


def test_a_point_at_a_singular_elevation_leaves_the_information_finite() -> None:
    world = make_world(0)
    xyz_m = world.xyz_m.copy()
    bundle = _solve(world)
    tracks = world.problem.tracks
    last = np.flatnonzero(tracks.track == 3)[-1]
    above_m = back_project(tracks.range_m[last], tracks.bearing_rad[last], np.pi / 2 - 1e-5)  # elevations are singular
    xyz_m[3] = transform(bundle.world_from_vehicle[tracks.frame[last]] @ LEVER_ARM, above_m)
    graph = gtsam.NonlinearFactorGraph()
    add_aperture_priors(graph, world.problem, bundle.world_from_vehicle, xyz_m)
    values = gtsam.Values(bundle.values)
    values.update(FIRST_POINT + 3, xyz_m[3])
    information, _ = graph.linearize(values).hessian()
    assert np.abs(information).max() < 1e9


def test_same_input_same_bytes() -> None:
    first, again = (_solve(make_world(8, frame_count=8, points=20)) for _ in range(2))
    assert first.world_from_vehicle.tobytes() == again.world_from_vehicle.tobytes()
    assert first.xyz_m.tobytes() == again.xyz_m.tobytes()


@pytest.mark.parametrize("channel", [0, 1, 2])
@pytest.mark.parametrize("heading_rad", [0.2, 1.5, -2.5])
def test_one_channel_of_navigation_alone_moves_no_other_angle_at_any_heading(channel: int, heading_rad: float) -> None:
    """Height, roll or pitch differs from odometry by a constant; the other angle keeps odometry's value."""
    turn = make_pose(np.zeros(3), Rotation.from_euler("z", heading_rad))
    world = make_world(6, frame_count=6, points=1)
    slopes = np.outer(np.arange(6), [0.05, 0.01, 0.02])
    poses = turn @ make_pose(world.poses[:, :3, 3], Rotation.from_euler("ZYX", slopes))
    recorded = np.column_stack([poses[:, 2, 3], slopes[:, 2], slopes[:, 1]])
    offset, sigma = np.zeros(3), np.full(recorded.shape, np.inf)
    offset[channel], sigma[:, channel] = 0.03, 1e-3
    sensors = SensorConstraints(
        poses[0],
        np.array([0.3, 0.3, 1e-6, 1e-6, 1e-6, 0.3]),
        True,
        invert(poses[:-1]) @ poses[1:],
        np.full((5, 2), 0.01),
        recorded + offset,
        sigma,
    )
    blind = replace(world.problem, sensors=sensors, observed=np.zeros(len(world.problem.tracks), dtype=bool))
    found = adjust_bundle(blind, poses, world.start_xyz_m, relative_tolerance=1e-9).world_from_vehicle
    angles = Rotation.from_matrix(found[:, :3, :3]).as_euler("ZYX")
    moved = np.column_stack([found[:, 2, 3], angles[:, 2], angles[:, 1]]) - recorded
    compared = [0] if channel == 0 else [1, 2]  # an attitude that turns moves the height of what odometry chains
    np.testing.assert_allclose(moved[:, compared], np.tile(offset[compared], (6, 1)), atol=5e-3)


def test_every_optimisation_begins_with_points_inside_the_aperture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Points given high above the beams are first moved to its edge, at their range and bearing."""
    world = make_world(9, noise=0.0, drift=0.0, frame_count=3, points=12)
    still, first = np.repeat(world.poses[:1], 3, axis=0), world.problem.tracks.frame == 0
    sensors = replace(world.problem.sensors, steps=np.repeat(np.eye(4)[None], 2, axis=0))
    problem = replace(world.problem, observed=first, sensors=sensors)
    above = back_project(np.full(12, 5.0), np.linspace(-0.3, 0.3, 12), 1.0)
    begun: list[FloatArray] = []

    def begin(_: gtsam.NonlinearFactorGraph, initial: gtsam.Values) -> gtsam.Values:
        tracks = np.unique(problem.tracks.track[first]).tolist()
        begun.append(np.stack([initial.atPoint3(FIRST_POINT + track) for track in tracks]))
        return initial

    monkeypatch.setattr("asfm.backend.graph.bundle_adjustment._optimise", begin)
    adjust_bundle(problem, still, transform(still[0] @ LEVER_ARM, above))
    used = np.unique(problem.tracks.track[first])
    range_m, bearing_rad, elevation_rad = project(transform(invert(still[0] @ LEVER_ARM), begun[0]))
    np.testing.assert_allclose(elevation_rad, problem.half_aperture_rad)
    np.testing.assert_allclose(range_m, 5.0)
    np.testing.assert_allclose(bearing_rad, np.linspace(-0.3, 0.3, 12)[used], atol=1e-9)
