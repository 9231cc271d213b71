"""The planar filter on planted motions: outliers go, unknown elevations and few matches stay."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.frontend.matching.planar_ransac import cheapest_pairs, find_planar_outliers
from asfm.geometry.planar_motion import estimate_planar_motion_msac
from asfm.geometry.poses import make_pose
from asfm.types import FloatArray


def seen_twice(rng: np.random.Generator, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A planted a_from_b, and points in both frames."""
    motion = make_pose(np.append(rng.uniform(-0.5, 0.5, 2), 0.0), Rotation.from_euler("z", rng.uniform(-0.3, 0.3)))
    xy_b = rng.uniform([2, -3], [8, 3], (count, 2))
    return motion, xy_b @ motion[:2, :2].T + motion[:2, 3] + rng.normal(0, 0.005, (count, 2)), xy_b


@pytest.mark.parametrize("seed", range(6))
def test_outliers_go_even_where_most_are_and_none_is_surer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    planted, xy_a, xy_b = seen_twice(rng, 60)
    wrong = rng.permutation(60) < 36
    xy_a[wrong] = rng.uniform([2, -3], [8, 3], (36, 2))
    motion, outlier = find_planar_outliers(xy_a, xy_b, np.full(60, 0.05), rng.random(60))
    assert not outlier[~wrong].any()
    assert outlier[wrong].mean() > 0.9
    np.testing.assert_allclose(motion, planted, atol=0.03)


def test_surest_matches_are_tried_each_with_each() -> None:
    pairs = cheapest_pairs(np.array([0.5, 0.1, 0.9, 0.2]), count=3)
    assert {frozenset(pair) for pair in pairs.tolist()} == {frozenset(pair) for pair in ([1, 3], [1, 0], [3, 0])}


def test_the_same_matches_give_the_same_verdict() -> None:
    rng = np.random.default_rng(3)
    _, xy_a, xy_b = seen_twice(rng, 30)
    cost = np.zeros(30)
    first, second = (find_planar_outliers(xy_a, xy_b, np.full(30, 0.01), cost) for _ in range(2))
    assert first[0].tobytes() == second[0].tobytes() and first[1].tobytes() == second[1].tobytes()


@pytest.mark.parametrize("count", [0, 1, 3])
def test_too_few_are_not_judged(count: int) -> None:
    rng = np.random.default_rng(0)
    motion, outlier = find_planar_outliers(
        rng.random((count, 2)), rng.random((count, 2)), np.full(count, 1e-6), rng.random(count)
    )
    np.testing.assert_array_equal(motion, np.eye(4))
    assert outlier.tolist() == [False] * count


def test_points_on_one_spot_give_no_nan() -> None:
    xy = np.ones((6, 2))
    motion, agrees = estimate_planar_motion_msac(xy, xy, np.full(6, 0.1), cheapest_pairs(np.zeros(6)))
    assert np.isfinite(motion).all() and agrees.all()
