"""Elevation arcs: distances of matches from them against a dense search, projection, bounding boxes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from asfm.evaluation.arc_consistency import Tolerance, find_arc_inliers
from asfm.geometry.elevation_arcs import arc_box_candidates, arc_distances, arc_residuals, project_arcs
from asfm.geometry.poses import make_pose, transform, wrap_angle
from asfm.geometry.sonar import SonarModel, back_project
from asfm.navigation.pose_prediction import PosePrediction
from asfm.types import FloatArray
from tests.worlds import range_bearing

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.6, 0.6), (300, 128), 0.4)
SIGMA = np.array([0.03, 0.01])
SEEDS = st.integers(0, 2**32 - 1)


def small_motions(rng: np.random.Generator, count: int) -> FloatArray:
    """Draw relative poses (count, 4, 4) as between frames of a survey: the scene stays in front."""
    return make_pose(
        rng.normal(scale=0.2, size=(count, 3)), Rotation.from_rotvec(rng.normal(scale=0.1, size=(count, 3)))
    )


def scene(
    rng: np.random.Generator, count: int, elevation_rad: float = 0.2
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return b_from_a, and the pixels in a and b of points at random elevations within +-elevation_rad."""
    b_from_a = small_motions(rng, count)
    elevations_rad = rng.uniform(-elevation_rad, elevation_rad, count)
    xyz_m = back_project(rng.uniform(2, 10, count), rng.uniform(-0.6, 0.6, count), elevations_rad)
    return b_from_a, range_bearing(xyz_m), range_bearing(transform(b_from_a, xyz_m))


def search_densely(b_from_a: FloatArray, pixel_a: FloatArray, pixel_b: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return the smallest whitened distances over 20001 elevations, one match at a time."""
    elevation_rad = np.linspace(-0.2, 0.2, 20001)
    found = []
    for pose, a, b, sigmas in zip(b_from_a, pixel_a, pixel_b, np.broadcast_to(sigma, pixel_a.shape), strict=True):
        arc = range_bearing(transform(pose, back_project(a[0], a[1], elevation_rad)))
        found.append(np.hypot(*((arc - b) / sigmas).T).min())
    return np.array(found)


@settings(max_examples=25, deadline=None)
@given(SEEDS)
def test_residuals_equal_a_dense_search(seed: int) -> None:
    rng = np.random.default_rng(seed)
    b_from_a, pixel_a, pixel_b = scene(rng, 20, 0.25)
    pixel_b = pixel_b + rng.normal(scale=3.0, size=(20, 2)) * SIGMA
    residual = arc_residuals(SONAR, b_from_a, pixel_a, pixel_b, SIGMA)
    assert residual.shape == (20,)
    np.testing.assert_allclose(residual, search_densely(b_from_a, pixel_a, pixel_b, SIGMA), atol=0.02)


def test_residuals_use_the_sigmas_of_each_match() -> None:
    rng = np.random.default_rng(1)
    b_from_a, pixel_a, pixel_b = scene(rng, 30)
    sigma = SIGMA * rng.uniform(0.5, 2.0, (30, 2))
    pixel_b = pixel_b + rng.normal(scale=3.0, size=(30, 2)) * SIGMA
    residual = arc_residuals(SONAR, b_from_a, pixel_a, pixel_b, sigma)
    np.testing.assert_allclose(residual, search_densely(b_from_a, pixel_a, pixel_b, sigma), atol=0.02)
    alone = [
        arc_residuals(SONAR, b_from_a[i : i + 1], pixel_a[i : i + 1], pixel_b[i : i + 1], sigma[i])[0]
        for i in range(30)
    ]
    np.testing.assert_allclose(residual, alone, rtol=1e-12)


@settings(max_examples=50, deadline=None)
@given(SEEDS)
def test_points_inside_the_aperture_lie_on_their_arcs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert arc_residuals(SONAR, *scene(rng, 50), SIGMA).max() < 0.02


@settings(max_examples=25, deadline=None)
@given(SEEDS)
def test_residuals_agree_with_the_test_of_the_evaluation(seed: int) -> None:
    """The evaluation tests both errors at one elevation: a square, which circumscribes the circle of one sigma."""
    rng = np.random.default_rng(seed)
    b_from_a, pixel_a, pixel_b = scene(rng, 50)
    pixel_b = pixel_b + rng.normal(scale=1.5, size=(50, 2)) * SIGMA
    residual = arc_residuals(SONAR, b_from_a, pixel_a, pixel_b, SIGMA)
    fits = find_arc_inliers(pixel_a, pixel_b, b_from_a, SONAR, Tolerance(SIGMA[0], SIGMA[1]))
    assert fits[residual < 0.98].all()
    assert not fits[residual > 1.02 * np.sqrt(2)].any()


def test_residuals_without_motion_are_whitened_pixel_distances() -> None:
    """Without motion the arc projects to one pixel."""
    still = np.eye(4)[None].repeat(3, axis=0)
    pixel_a = np.array([[5.0, 0.1], [5.0, 0.1], [5.0, 0.1]])
    pixel_b = pixel_a + np.array([[2.0, 0.0], [0.0, -3.0], [3.0, 4.0]]) * SIGMA
    np.testing.assert_allclose(arc_residuals(SONAR, still, pixel_a, pixel_b, SIGMA), [2, 3, 5], atol=1e-9)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_mirrored_bearing_axis_gives_large_residuals(side: float) -> None:
    """The scene is on one side and the sonar moves and turns sideways: mirrored bearings do not fit."""
    rng = np.random.default_rng(2)
    b_from_a = make_pose(np.tile([0.1, 0.3, 0.0], (40, 1)), Rotation.from_rotvec(np.tile([0.0, 0.0, 0.15], (40, 1))))
    xyz_m = back_project(rng.uniform(3, 8, 40), side * rng.uniform(0.2, 0.5, 40), rng.uniform(-0.2, 0.2, 40))
    pixel_a, pixel_b = range_bearing(xyz_m), range_bearing(transform(b_from_a, xyz_m))
    mirror = np.array([1.0, -1.0])
    assert arc_residuals(SONAR, b_from_a, pixel_a, pixel_b, SIGMA).max() < 0.02
    assert arc_residuals(SONAR, b_from_a, pixel_a * mirror, pixel_b * mirror, SIGMA).min() > 5


def test_points_outside_the_aperture_have_large_residuals() -> None:
    heave = make_pose(np.array([[0.0, 0.0, -1.0]]), Rotation.identity(1))
    above = back_project(np.array([4.0]), np.array([0.1]), np.array([0.5]))
    pixel_a, pixel_b = range_bearing(above), range_bearing(transform(heave, above))
    assert arc_residuals(SONAR, heave, pixel_a, pixel_b, SIGMA)[0] > 5


def test_no_matches_have_no_residuals() -> None:
    nothing = np.zeros((0, 2))
    assert arc_residuals(SONAR, np.zeros((0, 4, 4)), nothing, nothing, SIGMA).shape == (0,)


@pytest.mark.parametrize("seed", range(4))
def test_bounding_boxes_keep_all_pixels_near_the_arcs(seed: int) -> None:
    """The box test may keep too many pixels, but keeps every one that the exact gate keeps."""
    rng = np.random.default_rng(seed)
    b_from_a = small_motions(rng, 1)
    _, pixel_a, _ = scene(rng, 40)
    _, pixel_b, _ = scene(rng, 50)
    margin = np.tile(3 * SIGMA, (40, 1))
    near = arc_box_candidates(project_arcs(SONAR, b_from_a[0], pixel_a), pixel_b, margin)
    a, b = (index.ravel() for index in np.indices((40, 50)))
    residual = arc_residuals(SONAR, b_from_a.repeat(2000, 0), pixel_a[a], pixel_b[b], SIGMA)
    assert near.ravel()[residual < 2.9].all()
    assert 0 < near.mean() < 0.2


def test_predicted_sigma_grows_with_the_gap_and_at_short_range() -> None:
    poses = make_pose(np.zeros((9, 3)), Rotation.identity(9))
    predicted = PosePrediction(poses, step_rotation_rad=0.01, step_translation_m=0.03)
    range_m = np.array([1.0, 6.0])
    none, one, four = (predicted.predicted_sigma(0, gap, range_m, SIGMA) for gap in (0, 1, 4))
    np.testing.assert_allclose(none, np.tile(SIGMA, (2, 1)))
    np.testing.assert_allclose(four**2 - none**2, 4 * (one**2 - none**2))
    np.testing.assert_allclose(one[:, 0], np.hypot(0.03, SIGMA[0]))
    assert one[0, 1] > one[1, 1] > SIGMA[1]


def test_predicted_sigma_equals_the_spread_under_sampled_step_errors() -> None:
    """For a point at elevation zero."""
    rng = np.random.default_rng(5)
    turns = Rotation.from_rotvec(rng.normal(0, 0.01, (16000, 3)))
    steps = make_pose(rng.normal(0, 0.03, (16000, 3)), turns).reshape(4000, 4, 4, 4)
    point = back_project(np.array(4.0), np.array(0.3), 0.0)
    moved = np.tile(point, (4000, 1))
    for step in range(4):
        moved = transform(steps[:, step], moved)
    predicted = PosePrediction(np.eye(4)[None].repeat(5, 0), 0.01, 0.03)
    stated = predicted.predicted_sigma(0, 4, np.array([4.0]), np.zeros(2))[0]
    np.testing.assert_allclose((range_bearing(moved) - [4.0, 0.3]).std(axis=0), stated, rtol=0.05)


@pytest.mark.parametrize("turn_rad", [0.1, np.pi])
def test_projected_arcs_equal_the_projection_of_their_points(turn_rad: float) -> None:
    """After half a turn the scene is behind the sonar, where bearings wrap; those of one arc must not jump."""
    rng = np.random.default_rng(6)
    pixel_a = np.stack([rng.uniform(1, 9, 30), rng.uniform(-0.6, 0.6, 30)], axis=1)
    b_from_a = make_pose(np.array([0.3, -0.2, 0.1]), Rotation.from_euler("zy", [turn_rad, 0.1]))
    arcs = project_arcs(SONAR, b_from_a, pixel_a, 9)
    expected = range_bearing(transform(b_from_a, SONAR.elevation_arc(pixel_a[:, 0], pixel_a[:, 1], 9)))
    np.testing.assert_allclose(arcs[..., 0], expected[..., 0])
    np.testing.assert_allclose(np.exp(1j * arcs[..., 1]), np.exp(1j * expected[..., 1]), atol=1e-12)
    assert np.abs(np.diff(arcs[..., 1], axis=1)).max() < 1


def test_projected_arcs_behind_a_frame_have_no_jump() -> None:
    """A sonar that turned by half a turn has all of them behind it, at bearings around pi and minus pi."""
    turned = make_pose(np.array([0.3, 0.05, 0.2]), Rotation.from_euler("ZYX", [np.pi, 0.0, 0.4]))
    pixel = np.stack([np.full(41, 4.0), np.linspace(-0.3, 0.3, 41)], axis=1)
    arcs = project_arcs(SONAR, turned, pixel, 15)
    expected = range_bearing(transform(turned, SONAR.elevation_arc(pixel[:, 0], pixel[:, 1], 15)))
    assert np.ptp(expected[..., 1], axis=1).max() > 6, "without unwrapping some jump"
    assert np.ptp(arcs[..., 1], axis=1).max() < 1
    np.testing.assert_allclose(np.exp(1j * arcs[..., 1]), np.exp(1j * expected[..., 1]), atol=1e-9)
    np.testing.assert_allclose(arcs[..., 0], expected[..., 0])


def test_arcs_behind_the_sonar_are_those_ahead_turned_by_half_a_turn() -> None:
    """Bearings of a sonar that sees all around jump from pi to -pi astern; distances and boxes do not."""
    rng = np.random.default_rng(3)
    half_turn = make_pose(np.zeros(3), Rotation.from_rotvec([0.0, 0.0, np.pi]))
    xyz_m = back_project(rng.uniform(2, 8, 200), rng.uniform(-0.2, 0.2, 200), rng.uniform(-0.2, 0.2, 200))
    b_from_a = small_motions(rng, 1)[0]
    seen = transform(b_from_a, xyz_m)
    turned = range_bearing(transform(half_turn, xyz_m)), range_bearing(transform(half_turn, seen))
    residuals, boxes = [], []
    noise = rng.normal(scale=2.0, size=(200, 2)) * SIGMA
    for pose, pixel_a, pixel_b in (
        (b_from_a, range_bearing(xyz_m), range_bearing(seen)),
        (half_turn @ b_from_a @ half_turn, *turned),
    ):
        noisy = np.stack([pixel_b[:, 0] + noise[:, 0], wrap_angle(pixel_b[:, 1] + noise[:, 1])], axis=1)
        residuals.append(arc_residuals(SONAR, np.tile(pose, (200, 1, 1)), pixel_a, noisy, SIGMA))
        arcs = project_arcs(SONAR, pose, pixel_a)
        np.testing.assert_allclose(arc_distances(arcs, noisy, SIGMA), residuals[-1], atol=0.1)
        boxes.append(arc_box_candidates(arcs, noisy, np.tile(3 * SIGMA, (200, 1))))
    assert np.ptp(turned[1][:, 1]) > 6
    np.testing.assert_allclose(residuals[1], residuals[0], atol=1e-6)
    np.testing.assert_array_equal(boxes[1], boxes[0])
    assert boxes[0].any(axis=1).mean() > 0.9 and boxes[0].mean() < 0.5
