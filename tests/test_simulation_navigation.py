"""The simulated sensors err as much as they state."""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from asfm.poses import invert, make_pose
from asfm.simulation.navigation import simulate_navigation, simulate_odometry
from asfm.types import SensorNoise, Trajectory

NOISE = SensorNoise(0.02, 0.005, 0.01, 0.004, 0.003)


def _path(count: int) -> Trajectory:
    times = np.linspace(0.0, 0.2 * (count - 1), count)
    angles = np.stack([0.3 * np.sin(times / 9), 0.2 * np.cos(times / 7), times / 20], axis=-1)
    places = np.stack([times * 0.3, np.sin(times / 5), -0.1 * times], axis=-1)
    return Trajectory(times, make_pose(places, Rotation.from_euler("XYZ", angles)))


def test_odometry_steps_err_by_the_stated_sigmas() -> None:
    truth = _path(3000)
    odometry = simulate_odometry(truth, NOISE, np.random.default_rng(0)).world_from_vehicle
    true = truth.world_from_vehicle
    error = invert(invert(true[:-1]) @ true[1:]) @ invert(odometry[:-1]) @ odometry[1:]
    slip = error[:, :3, 3] / NOISE.odometry_translation_m
    turn = Rotation.from_matrix(error[:, :3, :3]).as_rotvec() / NOISE.odometry_rotation_rad
    for axis in range(3):
        assert stats.kstest(slip[:, axis], "norm").pvalue > 0.005
        assert stats.kstest(turn[:, axis], "norm").pvalue > 0.005
    assert np.allclose(odometry[0], true[0], atol=1e-12)
    assert np.abs(odometry[:, :3, :3] @ np.swapaxes(odometry[:, :3, :3], 1, 2) - np.eye(3)).max() < 1e-9


def test_odometry_drifts_and_its_end_spreads_as_theory_says() -> None:
    """With a still vehicle and no turning error the end's spread is sigma times the root of the steps."""
    still = Trajectory(np.linspace(0.0, 9.8, 50), np.tile(np.eye(4), (50, 1, 1)))
    noise = SensorNoise(0.02, 0.0, 0.01, 0.0, 0.0)
    ends = [simulate_odometry(still, noise, np.random.default_rng(i)).world_from_vehicle[-1, :3, 3] for i in range(400)]
    assert np.std(ends, axis=0) == pytest.approx(0.02 * np.sqrt(49), rel=0.12)


def test_depth_and_attitude_err_by_the_stated_sigmas() -> None:
    truth = _path(2000)
    reading = simulate_navigation(truth, NOISE, np.random.default_rng(1))
    _, pitch, roll = Rotation.from_matrix(truth.world_from_vehicle[:, :3, :3]).as_euler("ZYX").T
    assert stats.kstest((reading.z_m - truth.world_from_vehicle[:, 2, 3]) / 0.01, "norm").pvalue > 0.005
    assert stats.kstest((reading.roll_rad - roll) / 0.004, "norm").pvalue > 0.005
    assert stats.kstest((reading.pitch_rad - pitch) / 0.003, "norm").pvalue > 0.005
