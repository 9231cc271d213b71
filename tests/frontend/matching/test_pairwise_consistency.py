"""Bounds of lengths against a search over elevations, and the filter on a rigid scene."""

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
from asfm.geometry.sonar import back_project, project
from asfm.types import FloatArray

APERTURE = 0.4


def pixels(xyz_m: FloatArray) -> FloatArray:
    range_m, bearing_rad, _ = project(xyz_m)
    return np.stack([range_m, bearing_rad], axis=1)


@settings(max_examples=40, deadline=None)
@given(
    st.tuples(st.floats(0.1, 10), st.floats(0.1, 10)),
    st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5)),
    st.floats(0.01, 1.5),
)
def test_bounds_are_those_of_a_search_over_elevations(
    range_m: tuple[float, float], bearing_rad: tuple[float, float], aperture_rad: float
) -> None:
    least, greatest = distance_bounds_m(np.array(range_m), np.array(bearing_rad), aperture_rad)
    elevation_rad = np.linspace(-aperture_rad / 2, aperture_rad / 2, 81)
    first = back_project(np.array(range_m[0]), np.array(bearing_rad[0]), elevation_rad)
    second = back_project(np.array(range_m[1]), np.array(bearing_rad[1]), elevation_rad)
    length_m = np.linalg.norm(first[:, None] - second, axis=-1)
    assert least[0, 1] == pytest.approx(length_m.min(), abs=1e-6)
    assert greatest[0, 1] == pytest.approx(length_m.max(), abs=1e-6)
    np.testing.assert_allclose(least, least.T)
    assert least[0, 0] == 0


def rigid_pair(rng: np.random.Generator, count: int) -> tuple[FloatArray, FloatArray]:
    """Points seen before and after a motion in all six directions; all stay inside the aperture."""
    xyz_m = back_project(rng.uniform(2, 8, count), rng.uniform(-0.6, 0.6, count), rng.uniform(-0.1, 0.1, count))
    motion = make_pose(rng.uniform(-0.2, 0.2, 3), Rotation.from_rotvec([0.03, -0.03, rng.uniform(-0.2, 0.2)]))
    return pixels(xyz_m), pixels(transform(motion, xyz_m))


@pytest.mark.parametrize("seed", range(5))
def test_a_rigid_scene_is_consistent_without_slack(seed: int) -> None:
    pixel_a, pixel_b = rigid_pair(np.random.default_rng(seed), 50)
    assert pairwise_distance_consistency(pixel_a, pixel_b, APERTURE, np.full(50, 1e-9)).all()
    assert not find_distance_outliers(pixel_a, pixel_b, APERTURE, np.full(50, 1e-9)).any()


@pytest.mark.parametrize("seed", range(5))
def test_points_elsewhere_are_outliers_and_the_rest_is_not(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pixel_a, pixel_b = rigid_pair(rng, 60)
    wrong = np.arange(60) < 15
    pixel_b[wrong] = np.stack([rng.uniform(2, 8, 15), rng.uniform(-0.6, 0.6, 15)], axis=1)
    outliers = find_distance_outliers(pixel_a, pixel_b, APERTURE, np.full(60, 0.02))
    assert outliers[~wrong].sum() == 0
    assert outliers[wrong].sum() >= 10


def test_a_mirrored_bearing_axis_keeps_lengths_but_a_swapped_one_does_not() -> None:
    """Lengths do not see a mirror: what does is the planar filter."""
    pixel_a, pixel_b = rigid_pair(np.random.default_rng(1), 40)
    mirrored = pixel_b * [1, -1]
    assert not find_distance_outliers(pixel_a, mirrored, APERTURE, np.full(40, 0.01)).any()
    shuffled = pixel_b[::-1]
    assert find_distance_outliers(pixel_a, shuffled, APERTURE, np.full(40, 0.01)).mean() > 0.5


@pytest.mark.parametrize("count", [0, 1])
def test_nobody_and_one_alone_are_no_outliers(count: int) -> None:
    pixel_a, pixel_b = rigid_pair(np.random.default_rng(0), count)
    outliers = find_distance_outliers(pixel_a, pixel_b, APERTURE, np.zeros(count))
    assert outliers.shape == (count,) and not outliers.any()
