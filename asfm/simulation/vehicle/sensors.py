"""Simulated navigation sensors: odometry with drift, depth and attitude."""

from dataclasses import dataclass

import numpy as np

from asfm.geometry.poses import chain_steps, make_pose, steps_between, wrap_angle
from asfm.types import FloatArray, Navigation, SensorNoise, Trajectory

MIN_COS_PITCH = 1e-6
"""Cosine of the pitch below which roll is undefined; poses are accurate to about this."""


@dataclass(frozen=True)
class SlowDrift:
    """Slowly varying bias of the odometry: scale and misalignment of a DVL, bias of a gyro.

    A first-order Gauss-Markov process on each axis of a step, started in its stationary distribution.
    """

    translation_m: float = 0.001
    """Standard deviation of the bias of a step, each axis."""
    rotation_rad: float = float(np.deg2rad(0.01))
    """Standard deviation of the bias of a step, each axis."""
    correlation_s: float = 60.0
    """Time constant: the correlation falls to 1/e."""


def simulate_odometry(
    truth: Trajectory, noise: SensorNoise, rng: np.random.Generator, drift: SlowDrift | None = None
) -> Trajectory:
    """Simulate dead reckoning: chain noisy steps from the true first pose.

    Args:
        truth: world_from_vehicle.
        noise: sigma of every step between frames, in the vehicle's frame, on each axis of translation and of rotation
            (as a rotation vector); the errors are independent and Gaussian.
        rng: source of the errors.
        drift: slowly varying bias, added to the errors.

    Returns:
        The measured world_from_vehicle at the same time stamps, rotations orthonormal.
    """
    from scipy.spatial.transform import Rotation  # slow to load

    poses = truth.world_from_vehicle
    steps = steps_between(poses)
    error_m = noise.odometry_translation_m * rng.standard_normal((len(steps), 3))
    error_rad = noise.odometry_rotation_rad * rng.standard_normal((len(steps), 3))
    if drift is not None:
        bias = draw_gauss_markov(np.diff(truth.timestamps_s), drift.correlation_s, 6, rng)
        error_m += drift.translation_m * bias[:, :3]
        error_rad += drift.rotation_rad * bias[:, 3:]
    chain = chain_steps(poses[0], steps @ make_pose(error_m, Rotation.from_rotvec(error_rad)))
    chain = make_pose(chain[:, :3, 3], Rotation.from_matrix(chain[:, :3, :3]))  # orthonormal in spite of rounding
    return Trajectory(truth.timestamps_s, chain)


def draw_gauss_markov(elapsed_s: FloatArray, correlation_s: float, axes: int, rng: np.random.Generator) -> FloatArray:
    """Draw first-order Gauss-Markov processes of unit variance.

    Args:
        elapsed_s: (N,) time since the value before.
        correlation_s: time constant of the exponential correlation.
        axes: number of independent processes.
        rng: source of the values.

    Returns:
        (N, axes) values.
    """
    keep = np.exp(-elapsed_s / correlation_s)
    draws = rng.standard_normal((len(elapsed_s), axes))
    values = draws.copy()
    for index in range(1, len(values)):
        values[index] = keep[index] * values[index - 1] + np.sqrt(1 - keep[index] ** 2) * draws[index]
    return values


def simulate_navigation(truth: Trajectory, noise: SensorNoise, rng: np.random.Generator) -> Navigation:
    """Simulate depth, roll and pitch of the vehicle at every time stamp.

    Args:
        truth: world_from_vehicle.
        noise: sigmas of the independent Gaussian errors.
        rng: source of the errors.

    Returns:
        The readings; roll stays within -pi..pi and pitch within -pi/2..pi/2, as an attitude sensor reports them.
    """
    poses = truth.world_from_vehicle
    errors = rng.standard_normal((3, len(poses)))
    roll_rad, pitch_rad = measure_tilt(poses)
    noisy_roll_rad = roll_rad + noise.navigation_roll_rad * errors[1]
    return Navigation(
        truth.timestamps_s,
        poses[:, 2, 3] + noise.navigation_z_m * errors[0],
        np.where(np.abs(noisy_roll_rad) > np.pi, wrap_angle(noisy_roll_rad), noisy_roll_rad),
        np.clip(pitch_rad + noise.navigation_pitch_rad * errors[2], -np.pi / 2, np.pi / 2),
    )


def measure_tilt(world_from_vehicle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return roll and pitch in radians, (N,) each, of (N, 4, 4) poses, rotation = Rz(yaw) Ry(pitch) Rx(roll).

    The last row of the rotation, (-sin pitch, cos pitch sin roll, cos pitch cos roll), is the direction of gravity.
    Where the nose points straight up or down (gimbal lock) roll is undefined and returned as 0.
    """
    ahead, aside, up = world_from_vehicle[:, 2, :3].T
    level = np.hypot(aside, up)
    roll_rad = np.where(level > MIN_COS_PITCH, np.arctan2(aside, up), 0.0)
    return np.asarray(roll_rad), np.asarray(np.arctan2(-ahead, level))
