"""Planar motion by MSAC: recovery of the truth, agreement with SciPy's Kabsch solution, and degenerate points."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from asfm.geometry.planar_motion import _fit, _fit_pairs, _squared_distances, estimate_planar_motion_msac
from asfm.types import FloatArray, IntArray


def planar_pose(angle_rad: float, x_m: float, y_m: float) -> FloatArray:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", angle_rad).as_matrix()
    pose[:2, 3] = x_m, y_m
    return pose


def move(pose: FloatArray, xy: FloatArray) -> FloatArray:
    return np.asarray(xy @ pose[:2, :2].T + pose[:2, 3])


def all_pairs(count: int) -> IntArray:
    return np.array(list(combinations(range(count), 2)))


@given(st.floats(-3.1, 3.1), st.floats(-5, 5), st.floats(-5, 5), st.integers(2, 12), st.integers(0, 99))
def test_an_exact_motion_is_recovered(angle_rad: float, x_m: float, y_m: float, count: int, seed: int) -> None:
    xy_b = np.random.default_rng(seed).uniform((1, -3), (8, 3), (count, 2))
    truth = planar_pose(angle_rad, x_m, y_m)
    motion, inlier = estimate_planar_motion_msac(move(truth, xy_b), xy_b, np.full(count, 1e-3), all_pairs(count))
    np.testing.assert_allclose(motion, truth, atol=1e-9)
    assert inlier.all()


@pytest.mark.parametrize("seed", range(5))
def test_outliers_are_rejected_and_the_inliers_fitted_by_least_squares(seed: int) -> None:
    rng = np.random.default_rng(seed)
    xy_b, truth = rng.uniform((1, -3), (8, 3), (40, 2)), planar_pose(0.3, 0.5, -0.2)
    xy_a = move(truth, xy_b) + rng.normal(scale=0.01, size=(40, 2))
    xy_a[:15] += rng.uniform(0.5, 2, (15, 2)) * rng.choice([-1, 1], (15, 2))
    motion, inlier = estimate_planar_motion_msac(xy_a, xy_b, np.full(40, 0.06), all_pairs(40))
    np.testing.assert_array_equal(inlier, np.arange(40) >= 15)
    a, b = (np.pad(xy[inlier] - xy[inlier].mean(axis=0), ((0, 0), (0, 1))) for xy in (xy_a, xy_b))
    rotation = Rotation.align_vectors(a, b)[0].as_matrix()
    np.testing.assert_allclose(motion[:3, :3], rotation, atol=1e-9)
    np.testing.assert_allclose(move(motion, xy_b[inlier]).mean(axis=0), xy_a[inlier].mean(axis=0), atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_distances_and_fits_are_those_of_plain_matrices(seed: int) -> None:
    rng = np.random.default_rng(seed)
    xy_a, xy_b, samples = rng.normal(size=(9, 2)), rng.normal(size=(9, 2)), all_pairs(9)
    a, b = (np.asarray(xy[:, 0] + 1j * xy[:, 1], dtype=np.complex128) for xy in (xy_a, xy_b))
    rotation, translation = _fit_pairs(a, b, samples)
    np.testing.assert_allclose(np.abs(rotation), 1)
    distance2 = _squared_distances(a, b, rotation, translation)
    for sample, q, t, found in zip(samples, rotation, translation, distance2, strict=True):
        pose = planar_pose(float(np.angle(q)), t.real, t.imag)
        np.testing.assert_allclose(found, ((move(pose, xy_b) - xy_a) ** 2).sum(axis=1), atol=1e-9)
        again = _fit(a[None, sample], b[None, sample])
        np.testing.assert_allclose([again[0][0], again[1][0]], [q, t], atol=1e-9)


def test_the_sample_with_the_least_truncated_cost_is_chosen() -> None:
    """Two groups of points move differently; the larger one wins if it has a sample."""
    rng = np.random.default_rng(1)
    xy_b = rng.uniform((1, -3), (8, 3), (20, 2))
    poses = planar_pose(0.4, 1, 0), planar_pose(-0.6, -2, 1)
    xy_a = np.concatenate([move(poses[0], xy_b[:12]), move(poses[1], xy_b[12:])])
    tolerance_m = np.full(20, 0.05)
    both, smaller = np.array([[12, 15], [0, 5], [13, 2]]), np.array([[12, 15], [13, 2]])
    np.testing.assert_allclose(estimate_planar_motion_msac(xy_a, xy_b, tolerance_m, both)[0], poses[0], atol=1e-9)
    np.testing.assert_allclose(estimate_planar_motion_msac(xy_a, xy_b, tolerance_m, smaller)[0], poses[1], atol=1e-9)


def test_of_two_motions_with_as_many_inliers_the_one_they_fit_better_is_taken() -> None:
    rng = np.random.default_rng(4)
    xy_b = rng.uniform([2, -3], [8, 3], (12, 2))
    noisy = np.arange(12) < 6
    ring = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    noise_m = 0.04 * np.stack([np.cos(2 * ring), np.sin(2 * ring)], axis=1) * noisy[:, None]
    first, second = planar_pose(0.3, 1.0, 0.0), planar_pose(-0.2, -1.0, 0.5)
    xy_a = np.where(noisy[:, None], move(first, xy_b), move(second, xy_b)) + noise_m
    motion, inlier = estimate_planar_motion_msac(xy_a, xy_b, np.full(12, 0.15), all_pairs(12))
    np.testing.assert_array_equal(inlier, ~noisy)
    np.testing.assert_allclose(motion, second, atol=1e-9)


def test_every_point_has_its_own_tolerance() -> None:
    xy_b = np.array([[1.0, 0.0], [3.0, 0.0], [3.0, 2.0], [1.0, 2.0]])
    xy_a = xy_b + np.array([[0, 0], [0, 0], [0.1, 0.1], [0.1, 0.1]])
    inlier = estimate_planar_motion_msac(xy_a, xy_b, np.array([0.01, 0.01, 0.5, 0.01]), np.array([[0, 1]]))[1]
    np.testing.assert_array_equal(inlier[:2], [True, True])
    assert inlier[2] and not inlier[3]


def test_coinciding_points_give_a_pure_translation() -> None:
    xy_b = np.full((3, 2), 2.0)
    motion, inlier = estimate_planar_motion_msac(xy_b + np.array([1, -1]), xy_b, np.full(3, 0.1), all_pairs(3))
    np.testing.assert_allclose(motion, planar_pose(0, 1, -1), atol=1e-12)
    assert inlier.all()


def test_without_two_inliers_the_motion_is_that_of_the_best_sample() -> None:
    """Two points at different distances in the two frames: neither is an inlier."""
    xy_b = np.array([[0.0, 0.0], [2.0, 0.0]])
    motion, inlier = estimate_planar_motion_msac(1.5 * xy_b, xy_b, np.full(2, 0.1), np.array([[0, 1]]))
    np.testing.assert_allclose(motion, planar_pose(0, 0.5, 0), atol=1e-12)
    assert not inlier.any()
