"""Sensor constraints: steps, first pose and its sigmas, and which steps odometry measured."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import chain_steps, make_pose
from asfm.navigation.sensor_constraints import UNRELIABLE_SIGMA_FACTOR, level_pose
from asfm.types import FloatArray
from tests.worlds import INTERPOLATED_NOISE, make_constraints, make_interpolated_sequence

SEQUENCE = make_interpolated_sequence()
STATED = np.array([INTERPOLATED_NOISE.odometry_rotation_rad, INTERPOLATED_NOISE.odometry_translation_m])


def make_poses(seed: int = 0, count: int = 5) -> FloatArray:
    rng = np.random.default_rng(seed)
    return make_pose(rng.normal(0, 1, (count, 3)), Rotation.random(count, rng))


def test_steps_chain_back_to_the_poses_and_sigmas_are_those_given() -> None:
    poses, sigma = make_poses(), np.tile(STATED, (4, 1))
    sensors = make_constraints(SEQUENCE, poses, sigma, measured=True)
    np.testing.assert_allclose(chain_steps(sensors.first_pose, sensors.steps), poses, atol=1e-9)
    np.testing.assert_array_equal(sensors.step_sigma, sigma)
    np.testing.assert_allclose(sensors.z_roll_pitch_sigma, np.tile([0.05, 0.006, 0.008], (5, 1)))
    np.testing.assert_array_equal(sensors.depth_attitude.z_roll_pitch, sensors.z_roll_pitch)


def test_first_pose_is_fixed_except_in_what_navigation_measures() -> None:
    """In the world's axes: height, roll and pitch are as uncertain as their sensors, the rest is fixed."""
    poses = make_poses()
    readings = make_constraints(SEQUENCE, poses, np.ones((4, 2)), measured=True).z_roll_pitch
    poses[0] = level_pose(readings[0] + [0.1, -0.01, 0.01])
    sensors = make_constraints(SEQUENCE, poses, np.ones((4, 2)), measured=True)
    angle_rad = np.sqrt((0.006**2 + 0.008**2) / 2)
    np.testing.assert_allclose(sensors.first_sigma, [angle_rad, angle_rad, 1e-6, 1e-6, 1e-6, 0.05])
    blind = make_constraints(replace(SEQUENCE, navigation=None), poses, np.ones((4, 2)), measured=True)
    np.testing.assert_array_equal(blind.first_sigma, np.full(6, 1e-6))
    assert blind.z_roll_pitch.shape == blind.z_roll_pitch_sigma.shape == (0, 3)


def test_odometry_that_has_drifted_before_the_first_frame_is_no_tight_prior() -> None:
    """Where its first pose lies beyond three sigmas of the first reading, the distance is its sigma."""
    poses = make_poses()
    readings = make_constraints(SEQUENCE, poses, np.ones((4, 2)), measured=True).z_roll_pitch
    angle_rad = np.sqrt((0.006**2 + 0.008**2) / 2)
    for drift, expected in (
        ([0.25, 0.0, 0.0], [angle_rad, angle_rad, 0.25]),
        ([0.0, 0.06, 0.0], [0.06, 0.06, 0.05]),
        ([0.0, 0.01, -0.05], [0.05, 0.05, 0.05]),
    ):
        poses[0] = level_pose(readings[0] + drift)
        found = make_constraints(SEQUENCE, poses, np.ones((4, 2)), measured=True).first_sigma
        np.testing.assert_allclose(found[[0, 1, 5]], expected, rtol=1e-6)
        np.testing.assert_array_equal(found[2:5], np.full(3, 1e-6))


@pytest.mark.parametrize("measured", [True, False])
def test_steps_are_known_where_odometry_measured_them_about_as_well_as_stated(measured: bool) -> None:
    factor = np.array([1.0, 0.99 * UNRELIABLE_SIGMA_FACTOR, 1.01 * UNRELIABLE_SIGMA_FACTOR, 1.0])
    sigma = factor[:, None] * STATED
    sigma[3, 1] *= 5
    sensors = make_constraints(SEQUENCE, make_poses(), sigma, measured)
    expected = [True, True, False, False] if measured else [False] * 4
    assert sensors.known_steps(INTERPOLATED_NOISE).tolist() == expected


def test_typical_rotation_is_the_median_and_zero_without_steps() -> None:
    sigma = np.array([[0.1, 1.0], [0.2, 1.0], [0.9, 1.0], [0.3, 1.0]])
    assert make_constraints(SEQUENCE, make_poses(), sigma, measured=True).typical_rotation_rad == pytest.approx(0.25)
    single = make_interpolated_sequence(1)
    assert make_constraints(single, make_poses(count=1), np.zeros((0, 2)), measured=True).typical_rotation_rad == 0.0


def test_level_pose_has_the_depth_and_attitude_of_the_reading() -> None:
    pose = level_pose(np.array([-3.0, 0.2, -0.3]))
    np.testing.assert_allclose(pose[:3, 3], [0, 0, -3])
    np.testing.assert_allclose(Rotation.from_matrix(pose[:3, :3]).as_euler("ZYX"), [0.0, -0.3, 0.2], atol=1e-12)
