"""Simulated navigation sensors: their errors have the stated sigmas and correlations."""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import invert, make_pose
from asfm.simulation.vehicle.sensors import (
    SlowDrift,
    draw_gauss_markov,
    measure_tilt,
    simulate_navigation,
    simulate_odometry,
)
from asfm.types import SensorNoise, Trajectory

NOISE = SensorNoise(0.02, 0.005, 0.01, 0.004, 0.003)


def _path(count: int) -> Trajectory:
    times = np.linspace(0.0, 0.2 * (count - 1), count)
    angles = np.stack([0.3 * np.sin(times / 9), 0.2 * np.cos(times / 7), times / 20], axis=-1)
    places = np.stack([times * 0.3, np.sin(times / 5), -0.1 * times], axis=-1)
    return Trajectory(times, make_pose(places, Rotation.from_euler("XYZ", angles)))


def test_errors_of_odometry_steps_have_the_stated_sigmas() -> None:
    truth = _path(3000)
    odometry = simulate_odometry(truth, NOISE, np.random.default_rng(0)).world_from_vehicle
    true = truth.world_from_vehicle
    error = invert(invert(true[:-1]) @ true[1:]) @ invert(odometry[:-1]) @ odometry[1:]
    error_m = error[:, :3, 3] / NOISE.odometry_translation_m
    error_rad = Rotation.from_matrix(error[:, :3, :3]).as_rotvec() / NOISE.odometry_rotation_rad
    for axis in range(3):
        assert stats.kstest(error_m[:, axis], "norm").pvalue > 0.005
        assert stats.kstest(error_rad[:, axis], "norm").pvalue > 0.005
    assert np.allclose(odometry[0], true[0], atol=1e-12)
    assert np.abs(odometry[:, :3, :3] @ np.swapaxes(odometry[:, :3, :3], 1, 2) - np.eye(3)).max() < 1e-9


def test_dead_reckoning_is_a_random_walk() -> None:
    """Without motion and rotation error the sigma of the end is that of a step times the root of the steps."""
    still = Trajectory(np.linspace(0.0, 9.8, 50), np.tile(np.eye(4), (50, 1, 1)))
    noise = SensorNoise(0.02, 0.0, 0.01, 0.0, 0.0)
    ends = [simulate_odometry(still, noise, np.random.default_rng(i)).world_from_vehicle[-1, :3, 3] for i in range(400)]
    assert np.std(ends, axis=0) == pytest.approx(0.02 * np.sqrt(49), rel=0.12)


def test_errors_of_depth_and_attitude_have_the_stated_sigmas() -> None:
    truth = _path(2000)
    reading = simulate_navigation(truth, NOISE, np.random.default_rng(1))
    _, pitch, roll = Rotation.from_matrix(truth.world_from_vehicle[:, :3, :3]).as_euler("ZYX").T
    assert stats.kstest((reading.z_m - truth.world_from_vehicle[:, 2, 3]) / 0.01, "norm").pvalue > 0.005
    assert stats.kstest((reading.roll_rad - roll) / 0.004, "norm").pvalue > 0.005
    assert stats.kstest((reading.pitch_rad - pitch) / 0.003, "norm").pvalue > 0.005


@pytest.mark.filterwarnings("error")
def test_roll_and_pitch_are_defined_at_gimbal_lock() -> None:
    pitch = np.deg2rad([-90.0, -89.9999999, -60.0, 0.0, 89.0, 90.0, 90.0])
    angles = np.stack([np.linspace(-3, 3, 7), pitch, np.full(7, 0.4)], axis=-1)
    truth = Trajectory(np.arange(7.0), make_pose(np.zeros((7, 3)), Rotation.from_euler("ZYX", angles)))
    roll, found = measure_tilt(truth.world_from_vehicle)
    assert found == pytest.approx(pitch, abs=1e-6)
    assert roll == pytest.approx([0, 0, 0.4, 0.4, 0.4, 0, 0], abs=1e-6)
    reading = simulate_navigation(truth, NOISE, np.random.default_rng(0))
    assert np.isfinite(reading.roll_rad).all() and np.abs(reading.pitch_rad).max() <= np.pi / 2


def test_roll_is_wrapped_to_half_a_turn() -> None:
    upside_down = np.tile(make_pose(np.zeros(3), Rotation.from_euler("X", np.pi)), (500, 1, 1))
    reading = simulate_navigation(Trajectory(np.arange(500.0), upside_down), NOISE, np.random.default_rng(0))
    assert np.abs(reading.roll_rad).max() <= np.pi
    assert (reading.roll_rad > 3).any() and (reading.roll_rad < -3).any()


def test_slow_drift_is_correlated_over_steps_and_white_noise_is_not() -> None:
    still = Trajectory(np.linspace(0.0, 399.8, 2000), np.tile(np.eye(4), (2000, 1, 1)))
    silent = SensorNoise(0.0, 0.0, 0.0, 0.0, 0.0)
    drift = SlowDrift(translation_m=0.003, rotation_rad=0.0, correlation_s=20.0)
    path = simulate_odometry(still, silent, np.random.default_rng(2), drift).world_from_vehicle[:, :3, 3]
    steps = np.diff(path, axis=0)
    assert steps.std() == pytest.approx(0.003, rel=0.35)
    for elapsed in (5, 50):  # 1 and 10 s
        kept = np.corrcoef(steps[elapsed:].ravel(), steps[:-elapsed].ravel())[0, 1]
        assert kept == pytest.approx(np.exp(-elapsed * 0.2 / 20.0), abs=0.15)
    white = simulate_odometry(still, NOISE, np.random.default_rng(2)).world_from_vehicle
    white_steps = (invert(white[:-1]) @ white[1:])[:, :3, 3]
    assert abs(np.corrcoef(white_steps[1:].ravel(), white_steps[:-1].ravel())[0, 1]) < 0.05


def test_gauss_markov_process_starts_in_its_stationary_distribution() -> None:
    values = np.stack(
        [draw_gauss_markov(np.full(8, 0.2), 3.0, 6, np.random.default_rng(i))[[0, -1]] for i in range(400)]
    )
    assert values.std(axis=(0, 2)) == pytest.approx([1.0, 1.0], abs=0.06)
