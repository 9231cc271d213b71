"""Planar RANSAC on known motions: outliers are found, and too few matches have none."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.config import Config
from asfm.frontend.matching.planar_ransac import cheapest_pairs, find_planar_outliers, planar_tolerance_m
from asfm.geometry.feature_noise import relative_position_noise_m
from asfm.geometry.planar_motion import estimate_planar_motion_msac
from asfm.geometry.poses import make_pose
from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray


def moved_points(rng: np.random.Generator, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a random a_from_b, and points in frames a and b."""
    motion = make_pose(np.append(rng.uniform(-0.5, 0.5, 2), 0.0), Rotation.from_euler("z", rng.uniform(-0.3, 0.3)))
    xy_b = rng.uniform([2, -3], [8, 3], (count, 2))
    return motion, xy_b @ motion[:2, :2].T + motion[:2, 3] + rng.normal(0, 0.005, (count, 2)), xy_b


@pytest.mark.parametrize("seed", range(6))
def test_a_majority_of_outliers_is_found_at_random_costs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    true_motion, xy_a, xy_b = moved_points(rng, 60)
    wrong = rng.permutation(60) < 36
    xy_a[wrong] = rng.uniform([2, -3], [8, 3], (36, 2))
    motion, outlier = find_planar_outliers(xy_a, xy_b, np.full(60, 0.05), rng.random(60))
    assert not outlier[~wrong].any()
    assert outlier[wrong].mean() > 0.9
    np.testing.assert_allclose(motion, true_motion, atol=0.03)


def test_all_pairs_of_the_cheapest_matches_are_tried() -> None:
    pairs = cheapest_pairs(np.array([0.5, 0.1, 0.9, 0.2]), count=3)
    assert {frozenset(pair) for pair in pairs.tolist()} == {frozenset(pair) for pair in ([1, 3], [1, 0], [3, 0])}


def test_a_few_cheap_matches_outweigh_many_wrong_ones() -> None:
    """Three in four matches are wrong, at random; the cost tells which ones, their order does not."""
    rng = np.random.default_rng(7)
    true_motion, xy_a, xy_b = moved_points(rng, 80)
    wrong = np.arange(80) < 60
    xy_a[wrong] = rng.uniform([2, -3], [8, 3], (60, 2))
    motion, outlier = find_planar_outliers(xy_a, xy_b, np.full(80, 0.05), np.where(wrong, 0.9, 0.5))
    assert not outlier[~wrong].any() and outlier[wrong].mean() > 0.9
    np.testing.assert_allclose(motion, true_motion, atol=0.03)


def test_result_is_deterministic() -> None:
    rng = np.random.default_rng(3)
    _, xy_a, xy_b = moved_points(rng, 30)
    cost = np.zeros(30)
    first, second = (find_planar_outliers(xy_a, xy_b, np.full(30, 0.01), cost) for _ in range(2))
    assert first[0].tobytes() == second[0].tobytes() and first[1].tobytes() == second[1].tobytes()


@pytest.mark.parametrize("count", [0, 1, 3])
def test_fewer_than_four_matches_have_no_outliers(count: int) -> None:
    rng = np.random.default_rng(0)
    motion, outlier = find_planar_outliers(
        rng.random((count, 2)), rng.random((count, 2)), np.full(count, 1e-6), rng.random(count)
    )
    np.testing.assert_array_equal(motion, np.eye(4))
    assert outlier.tolist() == [False] * count


def test_coincident_points_give_a_finite_motion() -> None:
    xy = np.ones((6, 2))
    motion, inlier = estimate_planar_motion_msac(xy, xy, np.full(6, 0.1), cheapest_pairs(np.zeros(6)))
    assert np.isfinite(motion).all() and inlier.all()


@pytest.mark.parametrize(("beams", "bins"), [(16, 400), (512, 20), (512, 2000)])
def test_tolerances_are_a_share_of_the_range_but_at_least_the_noise(beams: int, bins: int) -> None:
    config = Config()
    sonar = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.6, 0.6), (bins, beams), 0.3)
    range_m = np.linspace(0.5, 10.0, 30)
    share_m = config.matching.planar_tolerance * range_m
    noise_m = relative_position_noise_m(range_m, sonar, config.noise)
    np.testing.assert_array_equal(planar_tolerance_m(range_m, sonar, config), np.maximum(share_m, noise_m))
    assert (noise_m > share_m).any()
