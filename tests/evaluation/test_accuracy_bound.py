"""Accuracy bound on scenes with known points: against an independent simulation, and its invariances."""

import json
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.ambiguity.motion_prior import estimate_step_sigma
from asfm.backend.estimation.solution import solve_tracks
from asfm.backend.graph import bundle_adjustment
from asfm.backend.graph.problem import BundleProblem
from asfm.backend.initialisation.initial_poses import initialise_from_odometry
from asfm.config import BackendConfig, Config
from asfm.errors import AsfmError
from asfm.evaluation.accuracy_bound import Bound, add_bound, measure_bound
from asfm.evaluation.pose_error_table import evaluate_sequence
from asfm.evaluation.trajectory import align_se3
from asfm.evaluation.true_points import TruePoints, find_true_points, measure_noise
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, project
from asfm.navigation.frame_navigation import read_navigation
from asfm.sequence import Sequence
from asfm.types import FloatArray, Frame, FrameTruth, IntArray, SensorNoise, Tracks, Trajectory

SONAR = SonarModel.evenly_spaced("test", (0.5, 8.0), (-0.8, 0.8), (300, 210), 0.5)
LEVER_ARM = make_pose(np.array([0.3, -0.1, 0.2]), Rotation.from_euler("ZYX", [0.1, 0.15, -0.05]))
FRAMES, POINTS = 16, 60
SIGMA = np.array([0.012, np.radians(0.25)])
ODOMETRY = SensorNoise()
INDEPENDENT = Config(backend=BackendConfig(track_correlation=0.0))


@dataclass(frozen=True)
class Scene:
    """Points in front of a vehicle that moves in all directions, each observed in every frame that sees it."""

    world_from_vehicle: FloatArray
    xyz_m: FloatArray
    track: IntArray
    frame: IntArray

    @cached_property
    def sonar_from_world(self) -> FloatArray:
        return invert(self.world_from_vehicle @ LEVER_ARM)

    def project(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the exact range_m, bearing_rad and elevation_rad of every observation."""
        return project(transform(self.sonar_from_world[self.frame], self.xyz_m[self.track]))

    def observe(self, sigma: FloatArray, seed: int = 0) -> Tracks:
        range_m, bearing_rad, _ = self.project()
        noise = np.random.default_rng(seed).normal(size=(len(range_m), 2)) * sigma
        return Tracks(self.track, self.frame, range_m + noise[:, 0], bearing_rad + noise[:, 1])

    def read_truth(self, index: int) -> FrameTruth:
        """Return the truth of a frame in which only the points echo, each from its pixel."""
        range_m, bearing_rad, elevation_rad = (value[self.frame == index] for value in self.project())
        image = np.full(SONAR.shape, np.nan)
        pixel = SONAR.row_at_range(range_m).astype(int), SONAR.column_at_bearing(bearing_rad).astype(int)
        image[pixel] = elevation_rad
        return FrameTruth(image, np.zeros(SONAR.shape, np.float32))

    def sequence(self, seed: int = 5, noise: SensorNoise = ODOMETRY, moved: FloatArray | None = None) -> Sequence:
        """Return the sequence, with drifting odometry, in another world if it is moved."""
        rng = np.random.default_rng(seed)
        steps = invert(self.world_from_vehicle[:-1]) @ self.world_from_vehicle[1:]
        turn = Rotation.from_rotvec(rng.normal(scale=noise.odometry_rotation_rad, size=(len(steps), 3)))
        steps = steps @ make_pose(rng.normal(scale=noise.odometry_translation_m, size=(len(steps), 3)), turn)
        poses = [self.world_from_vehicle[0] if moved is None else moved @ self.world_from_vehicle[0]]
        for step in steps:
            poses.append(poses[-1] @ step)
        stamps_s = 0.2 * np.arange(float(FRAMES))
        return Sequence(
            name="made up",
            sonar=SONAR,
            timestamps_s=stamps_s,
            read_frame=no_image,
            vehicle_from_sonar=LEVER_ARM,
            odometry=Trajectory(stamps_s, np.stack(poses)),
            groundtruth=Trajectory(stamps_s, self.world_from_vehicle),
            noise=noise,
        )


def no_image(index: int) -> Frame:
    raise AssertionError(f"the bound needs no image, frame {index} was requested")


@pytest.fixture(scope="module")
def scene() -> Scene:
    rng = np.random.default_rng(3)
    way = np.linspace(0, 1, FRAMES)[:, None]
    place_m = np.array([4.0, -3.0, 2.0]) + way * [0.3, 1.0, 0.0] + 0.15 * np.sin(6 * way + [0, 1, 2])
    world_from_vehicle = make_pose(place_m, Rotation.from_euler("ZYX", 0.2 * np.sin(5 * way + [2, 0, 1]) + [1, 0, 0]))
    from_m = SONAR.elevation_arc(rng.uniform(2, 7, 4 * POINTS), rng.uniform(-0.5, 0.5, 4 * POINTS), 9)
    in_sonar_m = from_m[np.arange(4 * POINTS), rng.integers(9, size=4 * POINTS)]
    xyz_m = transform((world_from_vehicle @ LEVER_ARM)[FRAMES // 2], in_sonar_m)
    seen = SONAR.sees(transform(invert(world_from_vehicle @ LEVER_ARM)[:, None], xyz_m))
    chosen = np.flatnonzero(seen.sum(axis=0) >= 5)[:POINTS]
    assert len(chosen) == POINTS
    track, frame = np.nonzero(seen[:, chosen].T)
    return Scene(world_from_vehicle, xyz_m[chosen], track, frame)


def bound_of(scene: Scene, tracks: Tracks, sequence: Sequence | None = None, config: Config | None = None) -> Bound:
    everything = np.ones(len(tracks), dtype=bool)
    return measure_bound(sequence or scene.sequence(), scene.read_truth, tracks, everything, config or Config())


def truth_of(scene: Scene, tracks: Tracks) -> TruePoints:
    return find_true_points(tracks, SONAR, scene.sonar_from_world, scene.read_truth)


def with_wrong_associations(tracks: Tracks, share: float) -> Tracks:
    """Exchange some observations for those of another track in the same frame, as wrong associations."""
    rng = np.random.default_rng(8)
    range_m, bearing_rad = tracks.range_m.copy(), tracks.bearing_rad.copy()
    for index in rng.choice(len(tracks), int(share * len(tracks)), replace=False).tolist():
        other = rng.choice(
            np.flatnonzero((tracks.frame == tracks.frame[index]) & (tracks.track != tracks.track[index]))
        )
        range_m[index], bearing_rad[index] = tracks.range_m[other], tracks.bearing_rad[other]
    return replace(tracks, range_m=range_m, bearing_rad=bearing_rad)


def ate_m(estimate: FloatArray, truth: FloatArray) -> float:
    aligned = align_se3(estimate, truth) @ estimate
    return float(np.sqrt(np.mean(np.sum((aligned - truth)[:, :3, 3] ** 2, axis=1))))


def test_points_are_found_despite_noise_and_wrong_associations(scene: Scene) -> None:
    for share in (0.0, 0.2):
        tracks = with_wrong_associations(scene.observe(SIGMA), share)
        truth = truth_of(scene, tracks)
        assert truth.known.all()
        error_m = np.linalg.norm(truth.xyz_m - scene.xyz_m, axis=1)
        assert np.median(error_m) < 0.01 and np.quantile(error_m, 0.9) < 0.06, "a neighbour's elevation may be closer"
        right = np.isclose(tracks.range_m, scene.observe(SIGMA).range_m)
        assert truth.inlier[right].mean() > 0.95 and truth.inlier[~right].sum() <= 0.1 * (~right).sum()
        range_m, bearing_rad, _ = scene.project()
        np.testing.assert_allclose(np.median(np.abs(truth.range_m - range_m)), 0, atol=0.006)
        np.testing.assert_allclose(np.median(np.abs(truth.bearing_rad - bearing_rad)), 0, atol=0.002)


def test_track_without_an_echo_has_no_point(scene: Scene) -> None:
    tracks = scene.observe(np.zeros(2))
    lost = tracks.track == 7
    shifted = replace(tracks, range_m=np.where(lost, 0.6, tracks.range_m))
    truth = truth_of(scene, shifted)
    assert np.flatnonzero(~truth.known).tolist() == [7] and not truth.inlier[lost].any()
    bound = bound_of(scene, shifted)
    assert (bound.tracks, bound.observations) == (POINTS - 1, len(tracks) - int(lost.sum()))


@pytest.mark.parametrize("factor", [0.5, 1.5])
def test_noise_is_that_added(scene: Scene, factor: float) -> None:
    tracks = with_wrong_associations(scene.observe(factor * SIGMA), 0.1)
    noise = measure_noise(tracks, truth_of(scene, tracks))
    assert noise is not None
    np.testing.assert_allclose(noise, factor * SIGMA, rtol=0.15)


def test_without_noise_the_bound_is_zero(scene: Scene) -> None:
    bound = bound_of(scene, scene.observe(np.zeros(2)))
    assert bound.ate_m < 1e-3
    np.testing.assert_allclose(bound.sigma, [0.01 * SONAR.range_step_m, 0.01 * SONAR.bearing_step_rad])
    assert ate_m(*odometry_and_truth(scene)) > 0.02, "or the test could not fail"


def odometry_and_truth(scene: Scene) -> tuple[FloatArray, FloatArray]:
    odometry = scene.sequence().odometry
    assert odometry is not None
    return odometry.world_from_vehicle, scene.world_from_vehicle


def test_bound_agrees_with_an_independent_simulation(scene: Scene) -> None:
    sequence = scene.sequence()
    initial = initialise_from_odometry(read_navigation(sequence, INDEPENDENT.backend), sequence)
    assert initial is not None
    errors_m = []
    for seed in range(6):
        tracks = scene.observe(SIGMA, 100 + seed)
        tracks = replace(tracks, sigma=np.tile(SIGMA, (len(tracks), 1)))
        solution = solve_tracks(tracks, sequence, initial.world_from_vehicle, initial.sensors, INDEPENDENT)
        errors_m.append(ate_m(solution.bundle.world_from_vehicle, scene.world_from_vehicle))
    expected_m = float(np.sqrt(np.mean(np.square(errors_m))))
    assert bound_of(scene, scene.observe(SIGMA)).ate_m == pytest.approx(expected_m, rel=0.25)


def test_bound_is_independent_of_associations_and_weights(scene: Scene) -> None:
    right = bound_of(scene, scene.observe(SIGMA))
    assert bound_of(scene, with_wrong_associations(scene.observe(SIGMA), 0.15)).ate_m == pytest.approx(
        right.ate_m, rel=0.2
    )
    weighed = replace(scene.observe(SIGMA), sigma=np.random.default_rng(1).uniform(1e-3, 1, (len(scene.track), 2)))
    assert bound_of(scene, weighed).ate_m == right.ate_m


def test_bound_grows_with_the_noise(scene: Scene) -> None:
    small, large = (bound_of(scene, scene.observe(factor * SIGMA)) for factor in (0.3, 1.5))
    assert 2 * small.ate_m < large.ate_m


def test_bound_is_independent_of_the_odometry_s_world(scene: Scene) -> None:
    moved = make_pose(np.array([30.0, -7.0, 1.0]), Rotation.from_euler("ZYX", [2.0, 0.3, -0.2]))
    tracks = scene.observe(SIGMA)
    at_home, elsewhere = (bound_of(scene, tracks, scene.sequence(moved=pose)) for pose in (None, moved))
    assert elsewhere.ate_m == pytest.approx(at_home.ate_m, rel=1e-3)


def test_same_seed_same_bound(scene: Scene) -> None:
    tracks = scene.observe(SIGMA)
    first, again, other = (bound_of(scene, tracks, config=Config(seed=seed)) for seed in (0, 0, 1))
    assert first.ate_m == again.ate_m != other.ate_m


def test_sonar_alone_has_a_bound_too(scene: Scene) -> None:
    alone = Config(backend=BackendConfig(use_odometry=False, use_navigation=False))
    bound = bound_of(scene, scene.observe(SIGMA), config=alone)
    assert bound.ate_m > bound_of(scene, scene.observe(SIGMA)).ate_m
    assert bound.ate_m < ate_m(np.tile(np.eye(4), (FRAMES, 1, 1)), scene.world_from_vehicle)


@pytest.mark.parametrize("alone", [True, False])
def test_the_motion_prior_of_the_sonar_alone_is_as_wide_as_that_of_the_run(
    scene: Scene, alone: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Truth that rotates much more than the planar odometry's prior expects; measured steps keep their sigmas."""
    sigmas = []

    def adjust(problem: BundleProblem, poses: FloatArray, *_: object) -> SimpleNamespace:
        sigmas.append(problem.sensors.step_sigma[:, 0].min())
        return SimpleNamespace(world_from_vehicle=poses)

    monkeypatch.setattr(bundle_adjustment, "adjust_bundle", adjust)
    bound_of(scene, scene.observe(SIGMA), config=Config(backend=BackendConfig(use_odometry=not alone)))
    expected_rad = estimate_step_sigma(scene.world_from_vehicle)[0]
    assert (min(sigmas) >= expected_rad * (1 - 1e-9)) == alone


@pytest.mark.parametrize("chosen", [0, 1])
def test_without_observations_the_bound_is_that_of_the_other_sensors(scene: Scene, chosen: int) -> None:
    tracks, sequence = scene.observe(SIGMA), scene.sequence()
    observed = np.arange(len(tracks)) < chosen
    bound = measure_bound(sequence, scene.read_truth, tracks, observed, Config())
    assert bound.observations == chosen
    assert bound.ate_m == pytest.approx(ate_m(*odometry_and_truth(scene)), rel=1e-3)


def test_only_observations_of_the_final_graph_count(scene: Scene) -> None:
    tracks = scene.observe(SIGMA)
    half = tracks.track % 2 == 0
    part = measure_bound(scene.sequence(), scene.read_truth, tracks, half, Config())
    assert (part.tracks, part.observations) == (POINTS // 2, int(half.sum()))


def test_without_true_poses_there_is_no_bound(scene: Scene) -> None:
    with pytest.raises(AsfmError, match=r"^made up: expected true poses[^\n]*$"):
        bound_of(scene, scene.observe(SIGMA), replace(scene.sequence(), groundtruth=None))


def test_bound_is_added_to_the_table(scene: Scene) -> None:
    sequence = scene.sequence()
    assert sequence.odometry is not None
    table = evaluate_sequence(sequence, sequence.odometry)
    added = add_bound(table, Bound(0.01, SIGMA, POINTS, 500))
    assert added.rows[: len(table.rows)] == table.rows and added.notes == table.notes
    odometry_m = ate_m(*odometry_and_truth(scene))
    assert added.row("bound_ate_rmse_m_se3").value == 0.01
    assert added.row("bound_ate_rmse_m_se3").ratio == pytest.approx(0.01 / odometry_m)
    assert added.row("ate_over_bound").value == pytest.approx(odometry_m / 0.01)
    assert added.row("feature_range_sigma_m").value == 0.012
    assert added.row("feature_bearing_sigma_deg").value == pytest.approx(0.25)
    json.dumps(added.as_dict(), allow_nan=False)
    perfect = add_bound(table, Bound(0.0, SIGMA, POINTS, 500))
    with pytest.raises(KeyError):
        perfect.row("ate_over_bound")


def test_the_graph_is_optimised_to_the_end(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tolerance ten thousand times tighter changes the bound by less than a fiftieth of a percent."""
    tracks = scene.observe(SIGMA)
    found = bound_of(scene, tracks).ate_m
    adjust = bundle_adjustment.adjust_bundle
    monkeypatch.setattr(bundle_adjustment, "adjust_bundle", lambda a, b, c, _: adjust(a, b, c, 1e-9))
    assert bound_of(scene, tracks).ate_m == pytest.approx(found, rel=2e-4)


def test_the_graph_begins_at_the_true_poses_in_the_odometry_s_world(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    moved = make_pose(np.array([30.0, -7.0, 1.0]), Rotation.from_euler("ZYX", [2.0, 0.3, -0.2]))

    def adjust(_: object, poses: FloatArray, *__: object) -> SimpleNamespace:
        np.testing.assert_allclose(poses, moved @ scene.world_from_vehicle, atol=1e-9)
        return SimpleNamespace(world_from_vehicle=poses)

    monkeypatch.setattr(bundle_adjustment, "adjust_bundle", adjust)
    assert bound_of(scene, scene.observe(SIGMA), scene.sequence(moved=moved)).ate_m < 1e-9
