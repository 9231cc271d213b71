"""Solution of one round: poses and points recovered, outliers and short tracks left out, sigmas inflated."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.estimation.solution import Solution, correlated_variance, solve_tracks
from asfm.config import BackendConfig, Config
from asfm.geometry.feature_noise import feature_sigma
from asfm.geometry.poses import chain_steps, make_pose, steps_between
from asfm.types import FloatArray, Tracks
from tests.worlds import (
    NO_TRACKS,
    VEHICLE_FRAMES,
    VEHICLE_SONAR,
    make_constraints,
    make_vehicle_path,
    make_vehicle_sequence,
    observe_floor,
)

SEQUENCE = make_vehicle_sequence()
STEP_SIGMA = np.tile([0.005, 0.02], (VEHICLE_FRAMES - 1, 1))


def solve(
    tracks: Tracks, poses: FloatArray, adjusted: bool = True, measured: bool = True, **backend: float
) -> Solution:
    config = Config(backend=BackendConfig.model_validate(backend))
    sensors = make_constraints(SEQUENCE, poses, STEP_SIGMA, measured)
    return solve_tracks(tracks, SEQUENCE, poses, sensors, config, adjusted)


def drift(seed: int) -> FloatArray:
    """Disturb the steps of the vehicle's path by the stated noise."""
    rng, path = np.random.default_rng(seed), make_vehicle_path()
    turn = Rotation.from_rotvec(rng.normal(0, 0.005, (VEHICLE_FRAMES - 1, 3)))
    noise = make_pose(rng.normal(0, 0.02, (VEHICLE_FRAMES - 1, 3)), turn)
    return chain_steps(path[0], steps_between(path) @ noise)


def position_error_m(poses: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum((poses - make_vehicle_path())[:, :3, 3] ** 2, axis=1))))


@pytest.fixture(scope="module")
def floor() -> Tracks:
    floor = observe_floor()
    return floor.select(floor.track % 3 == 0)


@pytest.fixture(scope="module")
def solution(floor: Tracks) -> Solution:
    return solve(floor, make_vehicle_path())


def test_tracks_reduce_the_drift_of_odometry(floor: Tracks) -> None:
    before, after = [], []
    for seed in range(3):
        poses = drift(seed)
        before.append(position_error_m(poses))
        after.append(position_error_m(solve(floor, poses, adjusted=False).bundle.world_from_vehicle))
    assert np.mean(after) < 0.5 * np.mean(before)


def test_outliers_are_not_used(floor: Tracks, solution: Solution) -> None:
    wrong = np.random.default_rng(0).random(len(floor)) < 0.1
    spoiled = Tracks(floor.track, floor.frame, floor.range_m + 1.0 * wrong, floor.bearing_rad)
    found = solve(spoiled, make_vehicle_path())
    many = np.bincount(floor.track, ~wrong, minlength=floor.count)[floor.track] >= 6
    assert found.observed[wrong & many].mean() < 0.02
    assert found.observed[~wrong & many].mean() > 0.9 * solution.observed[many].mean()


def test_tracks_with_few_views_are_left_out_and_long_ones_are_capped(floor: Tracks, solution: Solution) -> None:
    views = np.bincount(floor.track[solution.observed], minlength=floor.count)
    recorded = np.bincount(floor.track, minlength=floor.count)
    assert (recorded < Config().tracks.min_views).any() and not views[recorded < Config().tracks.min_views].any()
    assert set(np.unique(views)) <= {0, *range(Config().tracks.min_views, Config().backend.max_views + 1)}
    assert (views == Config().tracks.min_views).any()
    few = solve(floor, make_vehicle_path(), max_views=5)
    assert np.bincount(floor.track[few.observed]).max() == 5


def test_sigmas_are_inflated_by_the_correlation_of_a_track(floor: Tracks) -> None:
    independent, correlated = (
        solve(floor, make_vehicle_path(), adjusted=False, track_correlation=rho) for rho in (0.0, 0.5)
    )
    np.testing.assert_array_equal(independent.observed, correlated.observed)
    views = np.bincount(floor.track[independent.observed], minlength=floor.count)
    expected = np.sqrt(1 + 0.5 * np.maximum(views - 1, 0))[floor.track]
    np.testing.assert_allclose(correlated.problem.sigma / independent.problem.sigma, np.tile(expected, (2, 1)).T)
    np.testing.assert_array_equal(independent.elevation_information_ratio, 1.0)
    assert (correlated.elevation_information_ratio >= 1.0).all()


@pytest.mark.parametrize(("adjusted", "measured"), [(True, True), (False, True), (True, False)])
def test_autocorrelation_is_estimated_only_after_an_adjustment_with_odometry(adjusted: bool, measured: bool) -> None:
    """Range errors that persist along a track inflate the sigmas of ranges against those of bearings."""
    rng, exact = np.random.default_rng(0), observe_floor()
    exact = exact.select(exact.track % 3 == 0)
    error_m = rng.normal(0, 0.02, len(exact))
    for row in range(1, len(exact)):
        if exact.track[row] == exact.track[row - 1]:
            error_m[row] = 0.8 * error_m[row - 1] + 0.6 * error_m[row]
    tracks = Tracks(exact.track, exact.frame, exact.range_m + error_m, exact.bearing_rad)
    sigma = solve(tracks, make_vehicle_path(), adjusted, measured).problem.sigma
    default = feature_sigma(VEHICLE_SONAR, Config().noise)
    ratio = (sigma[:, 0] / sigma[:, 1]) / (default[0] / default[1])
    np.testing.assert_allclose(ratio, ratio[0])
    assert ratio[0] > 1.2 if adjusted and measured else ratio[0] == pytest.approx(1.0)


def test_without_tracks_the_poses_are_those_of_the_sensors() -> None:
    path, blind = make_vehicle_path(), replace(SEQUENCE, navigation=None)
    sensors = make_constraints(blind, path, STEP_SIGMA, measured=True)
    found = solve_tracks(NO_TRACKS, blind, path, sensors, Config())
    assert found.observed.shape == (0,) and found.bundle.xyz_m.shape == (0, 3)
    np.testing.assert_allclose(found.bundle.world_from_vehicle, path, atol=1e-6)


@pytest.mark.parametrize(("count", "rho"), [(1, 0.7), (5, 0.0), (5, 0.3), (20, 1.0)])
def test_variance_inflation_is_that_of_the_mean_of_correlated_values(count: int, rho: float) -> None:
    rng = np.random.default_rng(0)
    values = np.sqrt(rho) * rng.normal(size=(40_000, 1)) + np.sqrt(1 - rho) * rng.normal(size=(40_000, count))
    (factor,) = correlated_variance(np.array([count]), rho)
    assert count * values.mean(axis=1).var() == pytest.approx(factor, rel=0.04)
    assert correlated_variance(np.zeros(1, dtype=np.int64), rho) == 1.0


def test_elevations_have_the_smaller_correlation_of_the_two(floor: Tracks) -> None:
    rho, of_elevation, floor = 0.7, 0.2, floor.select(floor.track < 40)
    found = solve(floor, make_vehicle_path(), track_correlation=rho, elevation_correlation=of_elevation)
    views = np.bincount(floor.track[found.observed], minlength=floor.count)
    others = np.maximum(views - 1, 0)
    np.testing.assert_allclose(found.elevation_information_ratio, (1 + rho * others) / (1 + of_elevation * others))
    assert found.elevation_information_ratio.max() > 2


def test_errors_of_the_poses_are_not_taken_for_autocorrelated_features(floor: Tracks) -> None:
    """The poses are off by centimetres that change slowly, which all features of a frame have in common."""
    path, along = make_vehicle_path(), np.arange(VEHICLE_FRAMES)
    error_m = 0.02 * np.stack([np.sin(along / 4), np.cos(along / 5), np.sin(along / 6)], axis=1)
    slow = make_pose(error_m, Rotation.from_rotvec(0.1 * error_m))
    right, wrong = (np.median(solve(floor, poses).problem.sigma, axis=0) for poses in (path, path @ slow))
    np.testing.assert_allclose(wrong, right, rtol=0.15)
