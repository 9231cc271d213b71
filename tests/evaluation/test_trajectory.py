"""Trajectory errors, against evo (a test-time oracle only), rigid invariance and degenerate paths."""

from pathlib import Path

import numpy as np
import pytest
from evo.core import metrics
from evo.core.trajectory import PosePath3D
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from asfm.datasets import open_sequence
from asfm.evaluation.association import associate
from asfm.evaluation.trajectory import (
    absolute_errors,
    align_first_pose,
    align_se3,
    pairs_by_distance,
    pairs_by_step,
    path_length_m,
    relative_errors,
    summarise,
)
from asfm.geometry.poses import make_pose
from asfm.types import FloatArray, Trajectory

seeds = st.integers(0, 2**32 - 1)


def random_walk(seed: int, count: int = 40) -> FloatArray:
    rng = np.random.default_rng(seed)
    return make_pose(np.cumsum(rng.normal(size=(count, 3)), axis=0), Rotation.random(count, rng))


def disturb(poses: FloatArray, seed: int, translation_m: float = 0.1, rotation_rad: float = 0.05) -> FloatArray:
    rng = np.random.default_rng(seed)
    noise = Rotation.from_rotvec(rng.normal(scale=rotation_rad, size=(len(poses), 3)))
    return poses @ make_pose(rng.normal(scale=translation_m, size=(len(poses), 3)), noise)


def random_transform(seed: int, scale_m: float = 20.0) -> FloatArray:
    rng = np.random.default_rng(seed)
    return make_pose(rng.normal(scale=scale_m, size=3), Rotation.random(rng=rng))


def with_stamps(poses: FloatArray, start_s: float = 0.0) -> Trajectory:
    return Trajectory(start_s + 0.2 * np.arange(float(len(poses))), poses)


def evo_error(metric: metrics.PE, estimate: FloatArray, reference: FloatArray, alignment: str) -> FloatArray:
    """Return evo's values for the same poses."""
    estimated, true = PosePath3D(poses_se3=list(estimate)), PosePath3D(poses_se3=list(reference))
    if alignment == "se3":
        estimated.align(true)
    elif alignment == "first pose":
        estimated.align_origin(true)
    metric.process_data((true, estimated))
    return np.asarray(metric.error)


def assert_agrees_with_evo(estimate: FloatArray, reference: FloatArray) -> None:
    translation, rotation = metrics.PoseRelation.translation_part, metrics.PoseRelation.rotation_angle_rad
    for alignment, align in (("se3", align_se3), ("first pose", align_first_pose)):
        translation_m, rotation_rad = absolute_errors(align(estimate, reference) @ estimate, reference)
        for relation, found in ((translation, translation_m), (rotation, rotation_rad)):
            expected = evo_error(metrics.APE(relation), estimate, reference, alignment)
            np.testing.assert_allclose(found, expected, atol=1e-9)
    for step in (1, 7):
        pairs = pairs_by_step(len(estimate), step)
        for relation, found in zip((translation, rotation), relative_errors(estimate, reference, *pairs), strict=True):
            oracle = metrics.RPE(relation, delta=step, delta_unit=metrics.Unit.frames, all_pairs=True)
            np.testing.assert_allclose(found, evo_error(oracle, estimate, reference, "none"), atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_random_trajectories_agree_with_evo(seed: int) -> None:
    reference = random_walk(seed)
    assert_agrees_with_evo(random_transform(seed + 50) @ disturb(reference, seed + 100), reference)


def test_planar_trajectory_agrees_with_evo() -> None:
    reference = random_walk(7)
    reference[:, 2, 3] = 0.0
    assert_agrees_with_evo(disturb(reference, 8), reference)


def test_mirrored_trajectory_agrees_with_evo() -> None:
    reference = random_walk(9)
    mirrored = reference.copy()
    mirrored[:, 1, 3] *= -1
    assert_agrees_with_evo(mirrored, reference)


def test_recorded_odometry_agrees_with_evo(shared_data: Path) -> None:
    sequence = open_sequence(shared_data / "simulated_seafloor")
    assert sequence.odometry is not None
    assert sequence.groundtruth is not None
    pairs = associate(sequence.odometry, sequence.groundtruth)
    assert len(pairs) == len(sequence)
    assert_agrees_with_evo(pairs.estimate, pairs.reference)


def test_tank_trajectory_agrees_with_evo(shared_data: Path) -> None:
    reference = open_sequence(shared_data / "oculus_tank_b").groundtruth
    assert reference is not None
    assert_agrees_with_evo(disturb(reference.world_from_vehicle, 1, 0.01, 0.01), reference.world_from_vehicle)


def test_statistics_agree_with_evo() -> None:
    reference = random_walk(3)
    estimate = disturb(reference, 4)
    oracle = metrics.APE(metrics.PoseRelation.translation_part)
    evo_error(oracle, estimate, reference, "none")
    found, expected = summarise(absolute_errors(estimate, reference)[0]), oracle.get_all_statistics()
    np.testing.assert_allclose(
        (found.rmse, found.mean, found.median, found.max),
        [expected[name] for name in ("rmse", "mean", "median", "max")],
        atol=1e-12,
    )


@settings(max_examples=50)
@given(seeds, st.integers(2, 12))
def test_errors_are_independent_of_the_estimate_s_world(seed: int, count: int) -> None:
    reference = random_walk(seed, count)
    estimate = disturb(reference, seed + 1)
    moved = random_transform(seed + 2) @ estimate
    for align in (align_se3, align_first_pose):
        before = absolute_errors(align(estimate, reference) @ estimate, reference)
        after = absolute_errors(align(moved, reference) @ moved, reference)
        np.testing.assert_allclose(before, after, atol=1e-6)
    pairs = pairs_by_step(count)
    np.testing.assert_allclose(
        relative_errors(estimate, reference, *pairs), relative_errors(moved, reference, *pairs), atol=1e-6
    )


@settings(max_examples=50)
@given(seeds, st.integers(1, 12), st.sampled_from(["free", "planar", "straight", "static"]))
def test_a_moved_copy_has_no_error(seed: int, count: int, shape: str) -> None:
    reference = random_walk(seed, count)
    freedoms = {"free": [1, 1, 1], "planar": [1, 1, 0], "straight": [1, 0, 0], "static": [0, 0, 0]}[shape]
    reference[:, :3, 3] = reference[:, :3, 3] * freedoms + [5.0, -3.0, 2.0]
    reference = random_transform(seed + 1) @ reference
    moved = random_transform(seed + 2) @ reference
    for align in (align_se3, align_first_pose):
        translation_m, rotation_rad = absolute_errors(align(moved, reference) @ moved, reference)
        np.testing.assert_allclose(translation_m, 0, atol=1e-9)
        np.testing.assert_allclose(rotation_rad, 0, atol=1e-6)


@settings(max_examples=30)
@given(seeds, st.sampled_from(["free", "straight", "static"]))
def test_no_small_motion_improves_the_alignment(seed: int, shape: str) -> None:
    reference = random_walk(seed, 8)
    reference[:, :3, 3] *= {"free": [1, 1, 1], "straight": [1, 0, 0], "static": [0, 0, 0]}[shape]
    estimate = disturb(reference, seed + 1, 0.3, 0.3)
    best = align_se3(estimate, reference)
    cost = np.square(absolute_errors(best @ estimate, reference)[0]).sum()
    rng = np.random.default_rng(seed)
    for _ in range(10):
        turn = make_pose(rng.normal(scale=0.02, size=3), Rotation.from_rotvec(rng.normal(scale=0.02, size=3)))
        assert np.square(absolute_errors(turn @ best @ estimate, reference)[0]).sum() >= cost - 1e-9


@given(seeds)
def test_alignment_is_a_rotation_and_never_a_mirror(seed: int) -> None:
    alignment = align_se3(random_walk(seed, 6), random_walk(seed + 1, 6))
    np.testing.assert_allclose(alignment[:3, :3] @ alignment[:3, :3].T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(alignment[:3, :3]), 1, atol=1e-9)


def test_wrong_scale_is_an_error() -> None:
    reference = random_walk(11)
    estimate = reference.copy()
    estimate[:, :3, 3] *= 1.1
    translation_m, _ = absolute_errors(align_se3(estimate, reference) @ estimate, reference)
    spread_m = np.linalg.norm(reference[:, :3, 3] - reference[:, :3, 3].mean(axis=0), axis=1)
    np.testing.assert_allclose(summarise(translation_m).rmse, 0.1 * summarise(spread_m).rmse, rtol=1e-9)


def test_rotation_about_a_straight_path_is_that_of_the_orientations() -> None:
    reference = np.tile(np.eye(4), (5, 1, 1))
    reference[:, 0, 3] = np.arange(5.0)
    rolled = make_pose(np.zeros(3), Rotation.from_euler("x", 70, degrees=True)) @ reference
    np.testing.assert_allclose(align_se3(rolled, reference) @ rolled, reference, atol=1e-12)


def test_one_pose_and_two_poses_align() -> None:
    for count in (1, 2):
        reference = random_walk(2, count)
        moved = random_transform(3) @ reference
        np.testing.assert_allclose(align_se3(moved, reference) @ moved, reference, atol=1e-9)


def test_path_length_of_a_square() -> None:
    corners = np.tile(np.eye(4), (5, 1, 1))
    corners[:, :2, 3] = [[0, 0], [3, 0], [3, 3], [0, 3], [0, 0]]
    assert path_length_m(corners) == pytest.approx(12)
    assert path_length_m(corners[:1]) == 0


@given(seeds, st.integers(1, 15), st.floats(0.1, 10))
def test_pairs_by_distance_agree_with_a_brute_force_search(seed: int, count: int, distance_m: float) -> None:
    reference = random_walk(seed, count)
    along_m = [path_length_m(reference[: row + 1]) for row in range(count)]
    expected = []
    for first in range(count):
        later = [last for last in range(first, count) if along_m[last] - along_m[first] >= distance_m - 1e-12]
        expected += [(first, later[0])] if later else []
    assert list(zip(*(array.tolist() for array in pairs_by_distance(reference, distance_m)), strict=True)) == expected


def test_short_paths_have_no_pairs() -> None:
    for pairs in (pairs_by_step(1), pairs_by_step(3, 5), pairs_by_distance(random_walk(0, 4), 1e9)):
        assert [len(array) for array in pairs] == [0, 0]
    static = np.tile(np.eye(4), (4, 1, 1))
    assert len(pairs_by_distance(static, 0.0)[0]) == 0


@pytest.mark.parametrize("step_m", [0.1, 0.3, 0.7])
def test_rounding_of_an_even_path_lengthens_no_segment(step_m: float) -> None:
    path = np.tile(np.eye(4), (60, 1, 1))
    path[:, 0, 3] = 1000.0 + step_m * np.arange(60)
    first, last = pairs_by_distance(path, 3 * step_m)
    np.testing.assert_array_equal(last - first, 3)
    assert len(first) == 57
