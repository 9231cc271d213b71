"""What is left out of a reference, and that a right reference stays whole, whatever the estimate is."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.datasets import open_sequence
from asfm.errors import AsfmError
from asfm.evaluation.evaluation_table import EvaluationTable
from asfm.evaluation.pose_error_table import ATE_RMSE, evaluate_trajectory
from asfm.evaluation.reference_jumps import clean_reference
from asfm.geometry.poses import make_pose
from asfm.types import FloatArray, Trajectory
from tests.evaluation.test_association import half_circle

FRAMES = half_circle(np.arange(0, 20.01, 0.5))
LOST = [(4.2, 15.9), (0.0, 5.0), (14.0, 20.0), (9.0, 10.4)]


def spoil(reference: Trajectory, begin_s: float, end_s: float, poses: FloatArray) -> Trajectory:
    """Replace the poses within a time."""
    lost = (reference.timestamps_s >= begin_s) & (reference.timestamps_s <= end_s)
    spoiled = np.where(lost[:, None, None], poses, reference.world_from_vehicle)
    return Trajectory(reference.timestamps_s, spoiled)


def assert_named_and_left_out(reference: Trajectory, word: str, estimate: Trajectory = FRAMES) -> EvaluationTable:
    table = evaluate_trajectory(reference, None, estimate)
    assert table.row(ATE_RMSE).value < 0.01  # chords of what is bridged
    assert any(word in note for note in table.notes), table.notes
    assert all(len(note) < 400 and "\n" not in note for note in table.notes)
    return table


@pytest.mark.parametrize("interval_s", [0.05, 0.5])
@pytest.mark.parametrize(("begin_s", "end_s"), LOST)
def test_zeros_while_lost_are_left_out(interval_s: float, begin_s: float, end_s: float) -> None:
    reference = half_circle(np.arange(0, 20.01, interval_s))
    table = assert_named_and_left_out(spoil(reference, begin_s, end_s, np.eye(4)), "at zero")
    assert table.row("poses_compared").value <= 41 - (end_s - begin_s) / 0.5 + 3


@pytest.mark.parametrize("interval_s", [0.05, 0.5])
def test_the_last_pose_held_while_lost_is_left_out(interval_s: float) -> None:
    reference = half_circle(np.arange(0, 20.01, interval_s))
    held = reference.world_from_vehicle[np.searchsorted(reference.timestamps_s, 6.0)]
    assert_named_and_left_out(spoil(reference, 6.0, 13.0, held), "repeat one pose")


def test_a_pose_held_to_the_end_is_named() -> None:
    held = FRAMES.world_from_vehicle[30]
    notes = evaluate_trajectory(spoil(FRAMES, 15.0, 20.0, held), None, FRAMES).notes
    assert "repeat one pose" in notes[0] and "15.000-20.000 s" in notes[0]


@pytest.mark.parametrize("count", [1, 3])
def test_single_poses_metres_away_are_left_out(count: int) -> None:
    rng = np.random.default_rng(count)
    poses = FRAMES.world_from_vehicle.copy()
    poses[rng.choice(np.arange(2, 39, 6), count, replace=False), :3, 3] += [3.0, -2.0, 1.0]
    table = assert_named_and_left_out(Trajectory(FRAMES.timestamps_s, poses), "jumps of up to")
    assert table.row("poses_compared").value == 41 - count or table.row("poses_compared").value == 41


@pytest.mark.parametrize("axis", [[0, 0, 1], [0, 1, 0], [1, 0, 0]])
def test_rotations_that_jump_and_return_are_left_out(axis: list[int]) -> None:
    flipped = FRAMES.world_from_vehicle @ make_pose(np.zeros(3), Rotation.from_rotvec(np.pi / 2 * np.array(axis)))
    reference = spoil(FRAMES, 8.0, 11.0, flipped)
    table = assert_named_and_left_out(reference, "deg: left out")
    assert table.row("rotation_rmse_deg_aligned").value < 0.1


def test_after_a_jump_without_return_the_longer_part_counts() -> None:
    moved = make_pose(np.array([5.0, 0, 0]), Rotation.from_rotvec([0, 0, 0.3])) @ FRAMES.world_from_vehicle
    reference = spoil(FRAMES, 0.0, 6.0, moved)
    assert assert_named_and_left_out(reference, "jumps of up to").row("poses_compared").value == 28


@pytest.mark.parametrize("while_lost", [np.nan, np.inf])
def test_poses_that_are_not_finite_are_left_out(while_lost: float) -> None:
    reference = spoil(FRAMES, 4.2, 15.8, np.full((4, 4), while_lost))
    assert assert_named_and_left_out(reference, "not finite").row("poses_compared").value == 18


def test_one_hertz_held_between_its_readings_is_compared_at_them() -> None:
    at_s = np.arange(0, 20.01, 0.1)
    reference = half_circle(np.floor(at_s + 1e-9))
    staircase = Trajectory(at_s, reference.world_from_vehicle)
    table = evaluate_trajectory(staircase, None, FRAMES)
    assert table.row(ATE_RMSE).value < 0.04 and "repeat one pose" in table.notes[0]  # 0.4 m if compared as it is


def test_when_nothing_is_left_the_error_is_one_line_that_says_why() -> None:
    lost = Trajectory(FRAMES.timestamps_s, np.full((41, 4, 4), np.nan))
    with pytest.raises(AsfmError, match=r"found 0: .*41 of 41 poses of the reference.* are not finite") as caught:
        evaluate_trajectory(lost, None, FRAMES)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("estimate", ["true", "at rest", "noisy"])
@pytest.mark.parametrize("name", ["bestanp_eight", "holoocean_boat", "oculus_tank_a", "oculus_tank_b", "turtle_sim"])
def test_recorded_references_stay_whole_whatever_the_estimate(shared_data, name: str, estimate: str) -> None:  # type: ignore[no-untyped-def]
    truth = open_sequence(shared_data / name).groundtruth
    assert truth is not None
    rng = np.random.default_rng(0)
    poses = truth.world_from_vehicle.copy()
    if estimate == "at rest":
        poses[:] = poses[0]
    elif estimate == "noisy":
        poses[:, :3, 3] += np.cumsum(rng.normal(0, 0.2, (len(poses), 3)), axis=0)
    cleaned, notes = clean_reference(truth, replace(truth, world_from_vehicle=poses))
    assert notes == () and len(cleaned.timestamps_s) == len(truth.timestamps_s)


@pytest.mark.parametrize("sigma_m", [0.01, 0.3, 2.0])
@pytest.mark.parametrize("interval_s", [0.1, 1.0])
def test_noise_of_a_satellite_receiver_is_no_jump(sigma_m: float, interval_s: float) -> None:
    at_s = np.arange(0, 20.01, interval_s)
    for seed in range(10):
        poses = half_circle(at_s).world_from_vehicle
        poses[:, :3, 3] += np.random.default_rng(seed).normal(0, sigma_m, (len(at_s), 3))
        assert clean_reference(Trajectory(at_s, poses), FRAMES)[1] == ()


def test_a_vehicle_that_rests_and_starts_is_no_jump() -> None:
    """Rest to the last digit, then travel, then rest, as in simulations; the estimate knows, or never moves."""
    travelled = np.clip(np.arange(0, 20.01, 0.1) - 6, 0, 8)
    reference = Trajectory(np.arange(0, 20.01, 0.1), half_circle(travelled).world_from_vehicle)
    resting = replace(reference, world_from_vehicle=np.tile(np.eye(4), (201, 1, 1)))
    for estimate in (reference, resting):
        assert clean_reference(reference, estimate)[1] == ()


def test_an_estimate_that_jumps_is_not_excused() -> None:
    poses = FRAMES.world_from_vehicle.copy()
    poses[10:20, :3, 3] += [4.0, 0, 0]
    poses[30:, :3, 3] = poses[30, :3, 3]
    table = evaluate_trajectory(FRAMES, None, Trajectory(FRAMES.timestamps_s, poses))
    assert table.notes == () and table.row(ATE_RMSE).value > 1.0
