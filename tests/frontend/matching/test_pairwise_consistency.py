"""Pairwise consistency: distance bounds against a search over elevations, and outliers of a rigid scene."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from asfm.frontend.matching.pairwise_consistency import (
    distance_bounds_m,
    find_distance_outliers,
    pairwise_distance_consistency,
)
from asfm.geometry.poses import make_pose, transform
from asfm.geometry.sonar import back_project
from asfm.types import FloatArray
from tests.worlds import random_points, range_bearing

APERTURE_RAD = 0.4


@settings(max_examples=40, deadline=None)
@given(
    st.tuples(st.floats(0.1, 10), st.floats(0.1, 10)),
    st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5)),
    st.floats(0.01, 1.5),
)
def test_distance_bounds_equal_a_search_over_elevations(
    range_m: tuple[float, float], bearing_rad: tuple[float, float], aperture_rad: float
) -> None:
    lower_m, upper_m = distance_bounds_m(np.array(range_m), np.array(bearing_rad), aperture_rad)
    elevation_rad = np.linspace(-aperture_rad / 2, aperture_rad / 2, 81)
    first = back_project(np.array(range_m[0]), np.array(bearing_rad[0]), elevation_rad)
    second = back_project(np.array(range_m[1]), np.array(bearing_rad[1]), elevation_rad)
    distance_m = np.linalg.norm(first[:, None] - second, axis=-1)
    assert lower_m[0, 1] == pytest.approx(distance_m.min(), abs=1e-6)
    assert upper_m[0, 1] == pytest.approx(distance_m.max(), abs=1e-6)
    np.testing.assert_allclose(lower_m, lower_m.T)
    assert lower_m[0, 0] == 0


def rigid_pair(rng: np.random.Generator, count: int) -> tuple[FloatArray, FloatArray]:
    """Return the pixels of points before and after a 6-DoF motion; all stay inside the aperture."""
    xyz_m = random_points(rng, count, (2, 8), 0.6, 0.1)
    motion = make_pose(rng.uniform(-0.2, 0.2, 3), Rotation.from_rotvec([0.03, -0.03, rng.uniform(-0.2, 0.2)]))
    return range_bearing(xyz_m), range_bearing(transform(motion, xyz_m))


@pytest.mark.parametrize("seed", range(5))
def test_a_rigid_scene_is_consistent_without_slack(seed: int) -> None:
    pixel_a, pixel_b = rigid_pair(np.random.default_rng(seed), 50)
    assert pairwise_distance_consistency(pixel_a, pixel_b, APERTURE_RAD, np.full(50, 1e-9)).all()
    assert not find_distance_outliers(pixel_a, pixel_b, APERTURE_RAD, np.full(50, 1e-9)).any()


@pytest.mark.parametrize("seed", range(5))
def test_wrong_matches_are_outliers_and_correct_ones_are_not(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pixel_a, pixel_b = rigid_pair(rng, 60)
    wrong = np.arange(60) < 15
    pixel_b[wrong] = np.stack([rng.uniform(2, 8, 15), rng.uniform(-0.6, 0.6, 15)], axis=1)
    outliers = find_distance_outliers(pixel_a, pixel_b, APERTURE_RAD, np.full(60, 0.02))
    assert outliers[~wrong].sum() == 0
    assert outliers[wrong].sum() >= 10


def test_mirrored_bearings_keep_distances_but_shuffled_matches_do_not() -> None:
    """Distances are invariant to a mirror image; the planar filter is not."""
    pixel_a, pixel_b = rigid_pair(np.random.default_rng(1), 40)
    mirrored = pixel_b * [1, -1]
    assert not find_distance_outliers(pixel_a, mirrored, APERTURE_RAD, np.full(40, 0.01)).any()
    shuffled = pixel_b[::-1]
    assert find_distance_outliers(pixel_a, shuffled, APERTURE_RAD, np.full(40, 0.01)).mean() > 0.5


@pytest.mark.parametrize("count", [0, 1])
def test_no_match_or_a_single_one_is_no_outlier(count: int) -> None:
    pixel_a, pixel_b = rigid_pair(np.random.default_rng(0), count)
    outliers = find_distance_outliers(pixel_a, pixel_b, APERTURE_RAD, np.zeros(count))
    assert outliers.shape == (count,) and not outliers.any()


@pytest.mark.parametrize(("share", "consistent"), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize("swapped", [False, True])
def test_distances_may_differ_by_the_slacks_of_both_points_in_quadrature(
    share: float, consistent: bool, swapped: bool
) -> None:
    """Two points on one beam without elevation: their distance is that of their ranges."""
    slack_m = np.array([0.03, 0.04])
    near, far = np.array([[2.0, 0.1], [3.0, 0.1]]), np.array([[2.0, 0.1], [3.0 + share * 0.05, 0.1]])
    pixels = (far, near) if swapped else (near, far)
    assert pairwise_distance_consistency(*pixels, 1e-9, slack_m)[0, 1] == consistent


def test_an_aperture_beyond_half_a_turn_bounds_nothing_more_than_half_a_turn() -> None:
    range_m, bearing_rad = np.array([2.0, 3.0, 5.0]), np.array([-0.4, 0.0, 0.7])
    for wide, half_turn in zip(
        distance_bounds_m(range_m, bearing_rad, 5.0), distance_bounds_m(range_m, bearing_rad, np.pi), strict=True
    ):
        np.testing.assert_array_equal(wide, half_turn)
