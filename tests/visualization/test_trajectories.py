"""Trajectories in a recording: alignment at the first common pose, and drift."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import make_pose
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import FloatArray, Frame, Trajectory
from asfm.visualization.trajectories import align_first_pose, collect_trajectories, measure_drift


def make_path(count: int, step_m: float = 0.3) -> FloatArray:
    turn = 0.1 * np.arange(count)
    xyz_m = np.stack([turn * step_m * 10, np.sin(turn), 0.2 * turn], axis=-1)
    return make_pose(xyz_m, Rotation.from_euler("zyx", np.stack([turn, 0.3 + 0 * turn, 0.1 * turn], axis=-1)))


@given(seed=st.integers(0, 99), late_s=st.floats(0.0, 1.5))
@settings(max_examples=20, deadline=None)
def test_aligned_trajectory_keeps_its_shape_and_starts_on_the_estimate(seed: int, late_s: float) -> None:
    rng = np.random.default_rng(seed)
    stamps_s = np.linspace(0.0, 4.0, 17)
    estimate = Trajectory(stamps_s, make_path(17))
    elsewhere = make_pose(rng.normal(size=3), Rotation.from_rotvec(rng.normal(size=3)))
    other_s = np.linspace(late_s, 3.1, 200)
    other = Trajectory(other_s, elsewhere @ make_path(200, 0.1))
    anchored = align_first_pose(other, estimate)
    covered = (stamps_s >= late_s) & (stamps_s <= 3.1)
    np.testing.assert_array_equal(anchored.timestamps_s, stamps_s[covered])
    np.testing.assert_allclose(anchored.world_from_vehicle[0], estimate.world_from_vehicle[covered][0], atol=1e-9)
    moved = align_first_pose(replace(other, world_from_vehicle=elsewhere @ other.world_from_vehicle), estimate)
    np.testing.assert_allclose(moved.world_from_vehicle, anchored.world_from_vehicle, atol=1e-9)


def test_trajectories_without_common_time_give_no_poses() -> None:
    estimate = Trajectory(np.arange(5.0), make_path(5))
    assert align_first_pose(Trajectory(np.arange(5.0) + 100, make_path(5)), estimate).world_from_vehicle.shape == (
        0,
        4,
        4,
    )


def test_drift_is_the_distance_from_truth_aligned_at_the_first_pose() -> None:
    """Odometry with a scale error of 10 % in another world frame; the truth begins late, at another rate."""
    stamps_s, truth_s = np.linspace(0.0, 4.0, 9), np.linspace(0.7, 4.0, 50)
    straight = np.array([3.0, 0.0, 4.0])
    walked = make_pose(1.1 * stamps_s[:, None] * straight, Rotation.identity(9))
    elsewhere = make_pose(np.array([1.0, 2.0, 3.0]), Rotation.from_rotvec([0.3, -0.2, 2.0]))
    truth = elsewhere @ make_pose(truth_s[:, None] * straight, Rotation.identity(50))
    at_s, drift_m = measure_drift(Trajectory(stamps_s, walked), Trajectory(truth_s, truth))
    np.testing.assert_allclose(at_s, stamps_s[2:])
    np.testing.assert_allclose(drift_m, 0.5 * (stamps_s[2:] - 1.0), atol=1e-9)


def test_only_overlapping_trajectories_are_collected() -> None:
    estimate, past = Trajectory(np.arange(5.0), make_path(5)), Trajectory(np.arange(5.0) - 100, make_path(5))

    def read_frame(index: int) -> Frame:
        raise AssertionError("no frame is needed")

    sonar = SonarModel.evenly_spaced("toy", (0.5, 8.0), (-0.6, 0.5), (150, 110), 0.2)
    sequence = Sequence("toy", sonar, np.arange(3.0), read_frame)
    assert set(collect_trajectories(sequence, estimate)) == {"estimate"}
    assert set(collect_trajectories(replace(sequence, odometry=estimate, groundtruth=past), estimate)) == {
        "estimate",
        "odometry",
    }
