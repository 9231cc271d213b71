"""Motions of a reference beside an estimate's: lengths, noise, contradictions and jumping steps."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.evaluation.paired_motions import PairedMotions, jumping_steps, motion_lengths, step_vectors
from asfm.geometry.poses import make_pose, steps_between
from asfm.types import FloatArray

COUNT = 40
PATH_M = np.stack([0.1 * np.arange(COUNT), np.zeros(COUNT), np.zeros(COUNT)], axis=1)


def make_motions(turn_rad: FloatArray | None = None, xyz_m: FloatArray = PATH_M) -> PairedMotions:
    heading = np.zeros(COUNT) if turn_rad is None else turn_rad
    reference = make_pose(xyz_m, Rotation.from_rotvec(heading[:, None] * [0.0, 0.0, 1.0]))
    return PairedMotions(np.arange(float(COUNT)), reference, make_pose(PATH_M, Rotation.identity(COUNT)))


def test_lengths_are_those_of_the_steps() -> None:
    poses = make_pose(np.random.default_rng(0).normal(size=(5, 3)), Rotation.random(5, np.random.default_rng(1)))
    steps = steps_between(poses)
    expected = np.linalg.norm(steps[:, :3, 3], axis=1), Rotation.from_matrix(steps[:, :3, :3]).magnitude()
    np.testing.assert_allclose(np.linalg.norm(step_vectors(poses), axis=2), expected)
    np.testing.assert_allclose([motion_lengths(poses, i, i + 1) for i in range(4)], np.transpose(expected))


def test_noise_is_the_spread_of_the_differences() -> None:
    noisy = PATH_M + np.random.default_rng(0).normal(0, 0.01, PATH_M.shape)
    expected_m, expected_rad = make_motions(xyz_m=noisy).noise()
    assert 0.007 < expected_m < 0.025 and expected_rad == 0


@pytest.mark.parametrize(("jump_m", "expected"), [(0.0, []), (0.03, []), (1.0, [19, 20])])
def test_a_spike_is_two_steps_unless_it_is_small_or_the_estimate_makes_it_too(
    jump_m: float, expected: list[int]
) -> None:
    xyz_m = PATH_M.copy()
    xyz_m[20, 1] += jump_m
    motions = make_motions(xyz_m=xyz_m)
    assert np.flatnonzero(jumping_steps(motions)).tolist() == expected
    assert not jumping_steps(replace(motions, estimate=motions.reference)).any()
    assert motions.contradict(19, 20, np.zeros(2)) == (jump_m > 0.5)
    few = np.arange(COUNT) < 5
    assert not jumping_steps(motions.select(few)).any() and len(motions.select(few).reference) == 5


@pytest.mark.parametrize("turns", [True, False])
def test_a_sharp_turn_of_the_path_is_no_jump_and_a_turned_marker_is(turns: bool) -> None:
    """The estimate goes straight on, so that it contradicts both."""
    heading = np.where(np.arange(COUNT) >= 20, 1.5, 0.0)
    xyz_m = PATH_M.copy()
    if turns:
        along_m = 0.1 * np.arange(1, COUNT - 19)
        xyz_m[20:] = xyz_m[19] + np.stack([np.cos(1.5) * along_m, np.sin(1.5) * along_m, 0 * along_m], axis=1)
    found = np.flatnonzero(jumping_steps(make_motions(heading, xyz_m))).tolist()
    assert found == ([] if turns else [19])


@pytest.mark.parametrize(("moved_m", "turned_deg", "expected"), [(0.03, 3, False), (0.07, 0, True), (0.0, 7, True)])
def test_motions_within_the_noise_of_trackers_contradict_nothing(
    moved_m: float, turned_deg: float, expected: bool
) -> None:
    """The estimate rests and states no noise of its own."""
    still = np.zeros((COUNT, 3))
    after = np.arange(COUNT) >= 20
    moved = make_motions(np.deg2rad(turned_deg) * after, still + moved_m * after[:, None] * [1.0, 0.0, 0.0])
    resting = replace(moved, estimate=make_pose(still, Rotation.identity(COUNT)))
    assert resting.contradict(19, 20, np.zeros(2)) == expected


@pytest.mark.parametrize(("moved_m", "expected"), [(1.9, False), (2.2, True)])
def test_the_reference_contradicts_an_estimate_of_half_its_motion(moved_m: float, expected: bool) -> None:
    along = np.where(np.arange(COUNT) >= 20, 1.0, 0.0)[:, None] * [1.0, 0.0, 0.0]
    moved = make_motions(xyz_m=moved_m * along)
    halved = replace(moved, estimate=make_pose(along, Rotation.identity(COUNT)))
    assert halved.contradict(19, 20, np.zeros(2)) == expected


@pytest.mark.parametrize(("step_m", "expected"), [(0.3, []), (0.5, [20])])
def test_a_jump_is_four_times_as_long_as_the_even_steps_around_it(step_m: float, expected: list[int]) -> None:
    """It differs from them by three times their length; the estimate goes on as before."""
    steps_m = np.where(np.arange(COUNT - 1) == 20, step_m, 0.1)
    moved = make_motions(xyz_m=np.append(0.0, np.cumsum(steps_m))[:, None] * [1.0, 0.0, 0.0])
    assert np.flatnonzero(jumping_steps(moved)).tolist() == expected
