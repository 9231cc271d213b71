"""Arc consistency of matches, against exact matches and a dense search over elevations."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from asfm.evaluation.arc_consistency import Tolerance, find_arc_inliers
from asfm.geometry.poses import make_pose, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.types import BoolArray, FloatArray

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.6, 0.6), (300, 128), 0.4)


def motion(rng: np.random.Generator, scale: float) -> FloatArray:
    return make_pose(rng.normal(scale=scale, size=3), Rotation.from_rotvec(rng.normal(scale=0.3 * scale, size=3)))


def dense_error(
    a: FloatArray, b: FloatArray, sonar_b_from_sonar_a: FloatArray, tolerances: tuple[float, float]
) -> FloatArray:
    """Smallest error over a dense grid of elevations, over its tolerance."""
    arc_m = back_project(a[0][:, None], a[1][:, None], SONAR.elevations(5001))
    range_m, bearing_rad, _ = project(transform(sonar_b_from_sonar_a, arc_m))
    turn_rad = np.abs(np.angle(np.exp(1j * (bearing_rad - b[1][:, None]))))
    error = np.maximum(np.abs(range_m - b[0][:, None]) / tolerances[0], turn_rad / tolerances[1])
    return np.asarray(error.min(axis=1))


def inliers(a: FloatArray, b: FloatArray, sonar_b_from_sonar_a: FloatArray) -> BoolArray:
    return find_arc_inliers(a.T, b.T, sonar_b_from_sonar_a, SONAR)


@settings(max_examples=50)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 2))
def test_exact_matches_are_inliers_at_any_elevation_inside_the_aperture(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    b_from_a = motion(rng, scale)
    a = np.stack([rng.uniform(0.5, 10, 50), rng.uniform(-0.6, 0.6, 50)])
    in_b_m = transform(b_from_a, back_project(a[0], a[1], rng.uniform(-0.2, 0.2, 50)))
    range_m, bearing_rad, elevation_rad = project(in_b_m)
    visible = np.abs(elevation_rad) < 1.0  # above or below a sonar, outside any aperture, bearings change too fast
    assert inliers(a, np.stack([range_m, bearing_rad]), b_from_a)[visible].all()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 2))
def test_inliers_agree_with_a_dense_search(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    b_from_a = motion(rng, scale)
    a = np.stack([rng.uniform(0.5, 10, 40), rng.uniform(-0.6, 0.6, 40)])
    range_m, bearing_rad, _ = project(transform(b_from_a, back_project(a[0], a[1], rng.uniform(-0.25, 0.25, 40))))
    b = np.stack([range_m + rng.normal(scale=0.03, size=40), bearing_rad + rng.normal(scale=0.03, size=40)])
    error = dense_error(a, b, b_from_a, (0.02, float(np.radians(2))))
    clear = np.abs(error - 1) > 0.05
    np.testing.assert_array_equal(inliers(a, b, b_from_a)[clear], (error <= 1)[clear])


@pytest.mark.parametrize(
    ("range_m", "bearing_deg", "inlier"),
    [(0.019, 0, True), (0.021, 0, False), (-0.021, 0, False), (0, 1.9, True), (0, 2.1, False), (0.019, -1.9, True)],
)
def test_tolerances_without_motion(range_m: float, bearing_deg: float, inlier: bool) -> None:
    a = np.array([[3.0], [0.2]])
    b = a + np.array([[range_m], [np.radians(bearing_deg)]])
    assert inliers(a, b, np.eye(4)).tolist() == [inlier]
    assert find_arc_inliers(a.T, b.T, np.eye(4), SONAR, Tolerance(0.03, 0.05)).tolist() == [True]


def test_elevation_outside_the_aperture_is_no_inlier() -> None:
    b_from_a = make_pose(np.array([0.0, 0.0, 1.0]), Rotation.identity())
    a = np.array([[4.0, 4.0], [0.1, 0.1]])
    range_m, bearing_rad, _ = project(transform(b_from_a, back_project(a[0], a[1], np.array([0.19, 0.25]))))
    assert inliers(a, np.stack([range_m, bearing_rad]), b_from_a).tolist() == [True, False]


def test_one_transform_for_each_match_and_no_matches() -> None:
    rng = np.random.default_rng(0)
    transforms = np.stack([motion(rng, 0.5) for _ in range(6)])
    a = np.stack([rng.uniform(1, 9, 6), rng.uniform(-0.5, 0.5, 6)])
    range_m, bearing_rad, _ = project(transform(transforms, back_project(a[0], a[1], np.full(6, 0.1))))
    assert inliers(a, np.stack([range_m, bearing_rad]), transforms).all()
    assert not inliers(a, np.stack([range_m + 3, bearing_rad]), transforms).any()
    assert inliers(np.zeros((2, 0)), np.zeros((2, 0)), np.eye(4)).shape == (0,)


def test_a_jump_of_the_bearing_behind_the_sonar_is_no_inlier() -> None:
    turned = make_pose(np.zeros(3), Rotation.from_euler("zx", [np.pi, 0.3]))
    a = np.array([[3.0], [0.0]])
    assert inliers(a, np.array([[3.0], [0.0]]), turned).tolist() == [False]
    range_m, bearing_rad, _ = project(transform(turned, back_project(a[0], a[1], 0.1)))
    assert inliers(a, np.stack([range_m, bearing_rad]), turned).tolist() == [True]
