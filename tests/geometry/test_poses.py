"""Rigid transforms, against SciPy, plain matrix algebra and the properties of SLERP."""

import gtsam
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import (
    adjoint,
    angle_difference,
    depth_roll_pitch,
    interpolate,
    invert,
    make_pose,
    pose_from_tum,
    pose_log,
    transform,
    tum_from_pose,
)
from asfm.types import FloatArray

coordinates = st.floats(-100, 100, allow_subnormal=False)
seeds = st.integers(0, 2**32 - 1)


def random_poses(seed: int, count: int) -> FloatArray:
    rng = np.random.default_rng(seed)
    return make_pose(rng.normal(scale=5, size=(count, 3)), Rotation.random(count, rng))


@given(seeds)
def test_make_pose_places_rotation_and_translation(seed: int) -> None:
    rng = np.random.default_rng(seed)
    translation_m, rotation = rng.normal(size=(4, 3)), Rotation.random(4, rng)
    pose = make_pose(translation_m, rotation)
    np.testing.assert_array_equal(pose[:, 3], [[0, 0, 0, 1]] * 4)
    xyz_m = rng.normal(size=(4, 3))
    np.testing.assert_allclose(transform(pose, xyz_m), rotation.apply(xyz_m) + translation_m, atol=1e-12)


def test_tum_order_is_x_y_z_qx_qy_qz_qw() -> None:
    quarter_turn_about_z = np.array([1.0, 2.0, 3.0, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    pose = pose_from_tum(quarter_turn_about_z)
    np.testing.assert_allclose(pose, [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(tum_from_pose(pose), quarter_turn_about_z, atol=1e-12)


@given(seeds)
def test_tum_rows_round_trip(seed: int) -> None:
    pose = random_poses(seed, 5)
    rows = tum_from_pose(pose)
    assert rows.shape == (5, 7)
    assert np.all(rows[:, 6] >= 0)
    np.testing.assert_allclose(np.linalg.norm(rows[:, 3:], axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(pose_from_tum(rows), pose, atol=1e-12)


@given(seeds, st.floats(0.1, 10), st.sampled_from([-1.0, 1.0]))
def test_length_and_sign_of_a_quaternion_do_not_matter(seed: int, length: float, sign: float) -> None:
    rows = tum_from_pose(random_poses(seed, 3))
    scaled = rows * np.array([1, 1, 1] + [sign * length] * 4)
    np.testing.assert_allclose(pose_from_tum(scaled), pose_from_tum(rows), atol=1e-12)


def test_single_pose_keeps_its_shape() -> None:
    pose = random_poses(0, 1)[0]
    assert tum_from_pose(pose).shape == (7,)
    assert pose_from_tum(tum_from_pose(pose)).shape == (4, 4)
    assert invert(pose).shape == (4, 4)


@given(seeds)
def test_invert_agrees_with_linear_algebra(seed: int) -> None:
    pose = random_poses(seed, 4).reshape(2, 2, 4, 4)
    np.testing.assert_allclose(invert(pose), np.linalg.inv(pose), atol=1e-10)
    np.testing.assert_allclose(invert(invert(pose)), pose, atol=1e-12)


@given(seeds, hnp.arrays(float, (6, 3), elements=coordinates))
def test_transform_agrees_with_homogeneous_coordinates(seed: int, xyz_m: FloatArray) -> None:
    pose = random_poses(seed, 6)
    homogeneous = np.concatenate([xyz_m, np.ones((6, 1))], axis=1)
    np.testing.assert_allclose(
        transform(pose, xyz_m), np.matmul(pose, homogeneous[:, :, None])[:, :3, 0], rtol=1e-12, atol=1e-10
    )
    np.testing.assert_allclose(transform(invert(pose), transform(pose, xyz_m)), xyz_m, atol=1e-9)


def test_transform_broadcasts_both_ways() -> None:
    poses, points = random_poses(1, 4), np.random.default_rng(2).normal(size=(5, 3))
    assert transform(poses[0], points).shape == (5, 3)
    assert transform(poses, points[0]).shape == (4, 3)
    every = transform(poses[:, None], points)
    assert every.shape == (4, 5, 3)
    np.testing.assert_allclose(every[2, 3], transform(poses[2], points[3]))


@given(seeds, st.integers(1, 6))
def test_interpolation_at_the_stamps_is_the_pose(seed: int, count: int) -> None:
    pose = random_poses(seed, count)
    stamps_s = np.cumsum(np.random.default_rng(seed).uniform(0.01, 2, count))
    np.testing.assert_allclose(interpolate(stamps_s, pose, stamps_s), pose, atol=1e-9)


@given(seeds, st.floats(-3, 3).filter(lambda angle: abs(angle) > 1e-3), st.floats(0, 1))
def test_rotation_and_translation_advance_evenly(seed: int, angle_rad: float, fraction: float) -> None:
    start, axis = random_poses(seed, 1)[0], np.random.default_rng(seed).normal(size=3)
    turn = Rotation.from_rotvec(angle_rad * axis / np.linalg.norm(axis))
    step_m = np.array([3.0, -1.0, 2.0])
    end = make_pose(start[:3, 3] + step_m, Rotation.from_matrix(start[:3, :3]) * turn)
    found = interpolate(np.array([10.0, 12.0]), np.stack([start, end]), np.array([10 + 2 * fraction]))[0]
    np.testing.assert_allclose(found[:3, 3], start[:3, 3] + fraction * step_m, atol=1e-9)
    turned = Rotation.from_matrix(start[:3, :3].T @ found[:3, :3])
    np.testing.assert_allclose(turned.as_rotvec(), fraction * turn.as_rotvec(), atol=1e-7)


@given(seeds)
def test_interpolation_moves_with_the_world(seed: int) -> None:
    pose, world = random_poses(seed, 5), random_poses(seed + 1, 1)[0]
    stamps_s, at_s = np.arange(5.0), np.linspace(0, 4, 9)
    np.testing.assert_allclose(
        interpolate(stamps_s, world @ pose, at_s), world @ interpolate(stamps_s, pose, at_s), atol=1e-8
    )


def test_stamps_outside_take_the_nearest_end() -> None:
    pose = random_poses(3, 3)
    found = interpolate(np.array([1.0, 2.0, 4.0]), pose, np.array([-5.0, 0.999, 4.001, 100.0]))
    np.testing.assert_allclose(found, pose[[0, 0, 2, 2]], atol=1e-9)


@pytest.mark.parametrize("count", [1, 3])
def test_no_stamps_give_no_poses(count: int) -> None:
    assert interpolate(np.arange(float(count)), random_poses(0, count), np.zeros(0)).shape == (0, 4, 4)


def test_one_pose_holds_for_all_time() -> None:
    pose = random_poses(4, 1)
    np.testing.assert_array_equal(
        interpolate(np.array([5.0]), pose, np.array([0.0, 5.0, 9.0])), np.repeat(pose, 3, axis=0)
    )


@given(seeds, st.sampled_from([0.0, 1e-9, 1e-5, 2e-4, 0.03, 1.0, 3.0, np.pi - 1e-4]))
def test_logarithm_agrees_with_gtsam(seed: int, angle_rad: float) -> None:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(angle_rad * axis / np.linalg.norm(axis))
    pose = make_pose(rng.normal(size=3), turn)
    # Close to a half turn, the tangent's relative error is about 1e-16 over what is missing to pi.
    np.testing.assert_allclose(pose_log(pose), gtsam.Pose3.Logmap(gtsam.Pose3(pose)), atol=1e-8)


def test_logarithm_is_the_tangent_vector_of_local_coordinates() -> None:
    a, b = random_poses(5, 2)
    expected = gtsam.Pose3(a).localCoordinates(gtsam.Pose3(b))
    np.testing.assert_allclose(pose_log(invert(a) @ b), expected, atol=1e-9)
    stacked = random_poses(6, 6).reshape(2, 3, 4, 4)
    assert pose_log(stacked).shape == (2, 3, 6)
    np.testing.assert_array_equal(pose_log(stacked)[1, 2], pose_log(stacked[1, 2]))
    assert pose_log(stacked[:0]).shape == (0, 3, 6)


def test_angles_are_subtracted_the_short_way_round_and_exactly_where_they_are_near() -> None:
    rng = np.random.default_rng(0)
    first, second = rng.uniform(-np.pi, np.pi, (2, 1000))
    found = angle_difference(first, second)
    assert np.abs(found).max() <= np.pi
    np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * (first - second)), atol=1e-12)
    near = np.abs(first - second) <= np.pi
    assert 0.1 < near.mean() < 0.9
    np.testing.assert_array_equal(found[near], (first - second)[near])
    np.testing.assert_array_equal(angle_difference(first[near], second[near]), (first - second)[near])


def test_the_roll_of_a_vehicle_that_rolls_over_does_not_jump() -> None:
    roll_rad = np.linspace(-2.0, 9.0, 60)
    angles = np.stack([0.3 * roll_rad, np.full(60, 0.1), roll_rad], axis=1)
    poses = make_pose(np.zeros((60, 3)), Rotation.from_euler("ZYX", angles))
    found = depth_roll_pitch(poses)
    np.testing.assert_allclose(found[:, 1] - found[0, 1], roll_rad - roll_rad[0], atol=1e-9)
    np.testing.assert_allclose(found[:, 2], 0.1, atol=1e-9)


def test_the_adjoint_is_that_of_gtsam() -> None:
    rng = np.random.default_rng(5)
    poses = make_pose(rng.normal(size=(6, 3)), Rotation.random(6, rng)).reshape(2, 3, 4, 4)
    expected = [[gtsam.Pose3(pose).AdjointMap() for pose in row] for row in poses]
    np.testing.assert_allclose(adjoint(poses), expected, atol=1e-12)
