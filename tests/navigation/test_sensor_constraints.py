"""Sensors at the frames' stamps, and the constraints and starts made from them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from asfm.backend.initialisation.initial_poses import initialise_from_odometry
from asfm.config import BackendConfig
from asfm.geometry.poses import make_pose
from asfm.geometry.sonar import SonarModel
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.odometry import read_odometry
from asfm.navigation.sensor_constraints import level_pose, sensor_constraints
from asfm.sequence import Sequence
from asfm.types import FloatArray, Navigation, SensorNoise, Tracks, Trajectory
from tests.worlds import make_constraints, no_frame

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (500, 128), np.deg2rad(20))
NOTHING = Tracks(np.zeros(0, int), np.zeros(0, int), np.zeros(0), np.zeros(0))
NOISE = SensorNoise(0.03, 0.004, 0.05, 0.006, 0.008)


def _sequence(frame_count: int = 5) -> Sequence:
    """Frames at 0.5, 1.5 ... s; odometry and navigation at 0, 1, 2 ... s."""
    rng = np.random.default_rng(0)
    stamps = np.arange(frame_count + 1.0)
    poses = make_pose(rng.normal(0, 1, (len(stamps), 3)), Rotation.random(len(stamps), rng))
    navigation = Navigation(stamps, stamps * 0.1 - 2, 0.02 * stamps, -0.03 * stamps)
    return Sequence(
        "made up",
        SONAR,
        0.5 + np.arange(frame_count, dtype=np.float64),
        no_frame,
        odometry=Trajectory(stamps, poses),
        navigation=navigation,
        noise=NOISE,
    )


def odometry_poses(sequence: Sequence) -> FloatArray:
    odometry = read_odometry(sequence, BackendConfig())
    assert odometry is not None
    return odometry.world_from_vehicle


def test_odometry_between_its_stamps_is_linear_and_slerp() -> None:
    sequence = _sequence()
    assert sequence.odometry is not None
    poses = odometry_poses(sequence)
    given = sequence.odometry.world_from_vehicle
    np.testing.assert_allclose(poses[:, :3, 3], (given[:-1, :3, 3] + given[1:, :3, 3]) / 2, atol=1e-12)
    slerp = Slerp(sequence.odometry.timestamps_s, Rotation.from_matrix(given[:, :3, :3]))
    np.testing.assert_allclose(poses[:, :3, :3], slerp(sequence.timestamps_s).as_matrix(), atol=1e-12)


def test_navigation_between_its_stamps_is_linear() -> None:
    sequence = _sequence()
    expected = np.stack([f * sequence.timestamps_s for f in (0.1, 0.02, -0.03)], axis=1) - [2, 0, 0]
    np.testing.assert_allclose(
        read_navigation(sequence, BackendConfig()).depth_attitude.z_roll_pitch, expected, atol=1e-12
    )


def test_roll_across_half_a_turn_is_interpolated_the_short_way() -> None:
    sequence = _sequence(1)
    navigation = Navigation(np.array([0.0, 1.0]), np.zeros(2), np.array([3.1, -3.1]), np.zeros(2))
    roll_rad = read_navigation(replace(sequence, navigation=navigation), BackendConfig()).depth_attitude.z_roll_pitch[
        0, 1
    ]
    assert np.cos(roll_rad) == pytest.approx(-1.0)


@pytest.mark.parametrize("absent", ["file", "setting"])
def test_what_is_absent_or_unwanted_is_not_used(absent: str) -> None:
    sequence, config = _sequence(), BackendConfig()
    if absent == "file":
        sequence = replace(sequence, odometry=None, navigation=None)
    else:
        config = BackendConfig(use_odometry=False, use_navigation=False)
    navigation = read_navigation(sequence, config)
    assert navigation.odometry is None and navigation.depth_attitude.z_roll_pitch.shape == (0, 3)
    assert initialise_from_odometry(navigation, sequence) is None


def test_steps_chain_back_to_the_poses() -> None:
    sequence = _sequence()
    start = initialise_from_odometry(read_navigation(sequence, BackendConfig()), sequence)
    assert start is not None
    chained = [start.sensors.first_pose]
    for step in start.sensors.steps:
        chained.append(chained[-1] @ step)
    np.testing.assert_allclose(np.stack(chained), start.world_from_vehicle, atol=1e-9)
    np.testing.assert_array_equal(start.sensors.step_sigma, np.tile([0.004, 0.03], (4, 1)))
    np.testing.assert_allclose(start.sensors.z_roll_pitch_sigma, np.tile([0.05, 0.006, 0.008], (5, 1)))


def test_first_pose_is_held_but_for_what_navigation_measures() -> None:
    """In the world's axes: height, roll and pitch are as free as their sensors are vague, the rest is fixed."""
    sequence = _sequence()
    poses = odometry_poses(sequence)
    constraints = make_constraints(sequence, poses, np.ones((4, 2)), measured=True)
    rotation = poses[0, :3, :3]
    of_rotation = rotation @ constraints.first_covariance[:3, :3] @ rotation.T
    of_translation = rotation @ constraints.first_covariance[3:, 3:] @ rotation.T
    angle_rad = np.sqrt((0.006**2 + 0.008**2) / 2)
    np.testing.assert_allclose(of_rotation, np.diag([angle_rad, angle_rad, 1e-6]) ** 2, atol=1e-12)
    np.testing.assert_allclose(of_translation, np.diag([1e-6, 1e-6, 0.05]) ** 2, atol=1e-12)
    blind = sensor_constraints(
        replace(sequence, navigation=None),
        read_navigation(replace(sequence, navigation=None), BackendConfig()),
        poses,
        np.ones((4, 2)),
        measured=True,
    )
    np.testing.assert_allclose(blind.first_covariance, 1e-12 * np.eye(6), atol=1e-20)


def test_level_pose_has_the_reading_s_depth_and_attitude() -> None:
    pose = level_pose(np.array([-3.0, 0.2, -0.3]))
    np.testing.assert_allclose(pose[:3, 3], [0, 0, -3])
    np.testing.assert_allclose(Rotation.from_matrix(pose[:3, :3]).as_euler("ZYX"), [0.0, -0.3, 0.2], atol=1e-12)
