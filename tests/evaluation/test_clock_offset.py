"""Clock offsets: found with their sign where the path turns, and none where it would explain nothing."""

from pathlib import Path

import numpy as np
import pytest

from asfm.datasets import open_sequence
from asfm.evaluation.clock_offset import describe_clock_offset
from asfm.evaluation.pose_error_table import evaluate_trajectory
from asfm.types import Trajectory
from tests.navigation.test_local_world import UTM_M
from tests.worlds import make_vehicle_path

STAMPS_S = np.linspace(0, 7.8, 40)
TRUTH = Trajectory(STAMPS_S, make_vehicle_path())


@pytest.mark.parametrize("late_s", [-1.0, -0.4, 0.6, 2.0])
def test_an_offset_is_found_with_its_sign(late_s: float) -> None:
    poses = TRUTH.world_from_vehicle.copy()
    poses[:, :3, 3] += UTM_M
    (note,) = describe_clock_offset(TRUTH, Trajectory(STAMPS_S + late_s, poses))
    assert f"shifted by {-late_s:+.3g} s" in note and "the same clock" in note
    assert note in evaluate_trajectory(Trajectory(STAMPS_S + late_s, poses), None, TRUTH).notes


def test_no_shift_explains_noise_a_straight_path_or_rest() -> None:
    rng = np.random.default_rng(0)
    for spoil in ("noise", "drift", "straight", "rest", "nothing"):
        poses = TRUTH.world_from_vehicle.copy()
        if spoil in ("noise", "drift"):
            error_m = rng.normal(0, 0.1, (40, 3))
            poses[:, :3, 3] += error_m if spoil == "noise" else np.cumsum(error_m, axis=0)
        elif spoil != "nothing":
            poses[:] = poses[0]
            poses[:, 0, 3] += STAMPS_S * (spoil == "straight")
        assert describe_clock_offset(Trajectory(STAMPS_S, poses), TRUTH) == []


def test_recorded_odometry_and_truth_have_one_clock(shared_data: Path) -> None:
    sequence = open_sequence(shared_data / "simulated_seafloor")
    assert sequence.odometry is not None and sequence.groundtruth is not None
    assert describe_clock_offset(sequence.odometry, sequence.groundtruth) == []


def test_no_shift_is_found_by_leaving_most_of_the_poses_out() -> None:
    """On a straight path with errors in its middle the first and the last poses agree at any shift."""
    poses = np.repeat(np.eye(4)[None], 14, axis=0)
    poses[:, 0, 3] = STAMPS_S[:14]
    truth = Trajectory(STAMPS_S[:14], poses.copy())
    poses[4:10, 1, 3] += np.random.default_rng(0).normal(0, 0.5, 6)
    assert describe_clock_offset(Trajectory(STAMPS_S[:14], poses), truth) == []
