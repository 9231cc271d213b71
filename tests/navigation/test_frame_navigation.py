"""Navigation at the frame times: interpolation, sensors that are absent or not used, and the world frame."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from asfm.backend.initialisation.initial_poses import initialise_from_odometry
from asfm.config import BackendConfig
from asfm.geometry.poses import depth_roll_pitch, invert
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.odometry import read_odometry
from asfm.sequence import Sequence
from asfm.types import FloatArray, Navigation
from tests.worlds import make_interpolated_sequence, make_vehicle_path, make_vehicle_sequence


def odometry_poses(sequence: Sequence) -> FloatArray:
    odometry = read_odometry(sequence, BackendConfig())
    assert odometry is not None
    return odometry.world_from_vehicle


def test_odometry_is_interpolated_linearly_and_by_slerp() -> None:
    sequence = make_interpolated_sequence()
    assert sequence.odometry is not None
    poses = odometry_poses(sequence)
    given = sequence.odometry.world_from_vehicle
    np.testing.assert_allclose(poses[:, :3, 3], (given[:-1, :3, 3] + given[1:, :3, 3]) / 2, atol=1e-12)
    slerp = Slerp(sequence.odometry.timestamps_s, Rotation.from_matrix(given[:, :3, :3]))
    np.testing.assert_allclose(poses[:, :3, :3], slerp(sequence.timestamps_s).as_matrix(), atol=1e-12)


def test_depth_and_attitude_are_interpolated_linearly() -> None:
    sequence = make_interpolated_sequence()
    expected = np.stack([f * sequence.timestamps_s for f in (0.1, 0.02, -0.03)], axis=1) - [2, 0, 0]
    np.testing.assert_allclose(
        read_navigation(sequence, BackendConfig()).depth_attitude.z_roll_pitch, expected, atol=1e-12
    )


def test_roll_across_half_a_turn_is_interpolated_the_short_way() -> None:
    sequence = make_interpolated_sequence(1)
    navigation = Navigation(np.array([0.0, 1.0]), np.zeros(2), np.array([3.1, -3.1]), np.zeros(2))
    roll_rad = read_navigation(replace(sequence, navigation=navigation), BackendConfig()).depth_attitude.z_roll_pitch[
        0, 1
    ]
    assert np.cos(roll_rad) == pytest.approx(-1.0)


@pytest.mark.parametrize("absent", ["file", "setting"])
def test_sensors_that_are_absent_or_switched_off_are_not_used(absent: str) -> None:
    sequence, config = make_interpolated_sequence(), BackendConfig()
    if absent == "file":
        sequence = replace(sequence, odometry=None, navigation=None)
    else:
        config = BackendConfig(use_odometry=False, use_navigation=False)
    navigation = read_navigation(sequence, config)
    assert navigation.odometry is None and navigation.depth_attitude.z_roll_pitch.shape == (0, 3)
    assert initialise_from_odometry(navigation, sequence) is None


@pytest.mark.parametrize("conflict", [False, True])
def test_odometry_is_moved_to_the_depth_of_navigation_unless_they_contradict_each_other(conflict: bool) -> None:
    sequence = make_vehicle_sequence()
    assert sequence.odometry is not None and sequence.navigation is not None
    poses = sequence.odometry.world_from_vehicle.copy()
    poses[:, 2, 3] = (-3 if conflict else 1) * poses[:, 2, 3] + 12.0
    faulty = replace(sequence, odometry=replace(sequence.odometry, world_from_vehicle=poses))
    navigation = read_navigation(faulty, BackendConfig())
    assert navigation.odometry is not None
    found = navigation.odometry.world_from_vehicle
    codes = [item.code for item in navigation.diagnostics]
    if conflict:
        np.testing.assert_allclose(found, poses, atol=1e-9)
        assert "odometry-frame-offset" not in codes
    else:
        assert codes == ["odometry-frame-offset"]
        np.testing.assert_allclose(found[:5, 2, 3], make_vehicle_path()[:5, 2, 3], atol=0.06)
        np.testing.assert_allclose(invert(found[:-1]) @ found[1:], invert(poses[:-1]) @ poses[1:], atol=1e-9)


def test_diagnostics_of_all_sensors_are_joined() -> None:
    sequence = make_vehicle_sequence()
    assert sequence.odometry is not None and sequence.navigation is not None
    poses, z_m = sequence.odometry.world_from_vehicle.copy(), sequence.navigation.z_m.copy()
    poses[20:, 0, 3] += 3.0
    z_m[30] += 1.0
    faulty = replace(
        sequence,
        odometry=replace(sequence.odometry, world_from_vehicle=poses),
        navigation=replace(sequence.navigation, z_m=z_m),
    )
    navigation = read_navigation(faulty, BackendConfig())
    assert [item.code for item in navigation.diagnostics] == ["odometry-jump", "navigation-outliers"]
    np.testing.assert_allclose(navigation.depth_attitude.z_roll_pitch, depth_roll_pitch(make_vehicle_path()), atol=0.08)
