"""What the vehicle's own sensors report: drifting odometry, depth and attitude."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import invert, make_pose
from asfm.types import FloatArray, Navigation, SensorNoise, Trajectory

UPRIGHT = 1e-6
"""Cosine of the pitch below which there is no roll: poses are good to about this."""


@dataclass(frozen=True)
class SlowDrift:
    """The part of odometry's error that stays from step to step: a DVL's scale and mounting, a gyro's bias.

    A first-order Gauss-Markov process on each axis of a step, beginning in its steady state.
    """

    translation_m: float = 0.001
    """Standard deviation of a step's bias."""
    rotation_rad: float = float(np.deg2rad(0.01))
    """Standard deviation of a step's bias."""
    correlation_s: float = 60.0
    """Time in which the correlation falls to 1/e."""


def simulate_odometry(
    truth: Trajectory, noise: SensorNoise, rng: np.random.Generator, drift: SlowDrift | None = None
) -> Trajectory:
    """Chain noisy steps, beginning at the true first pose.

    Every step between frames gets independent Gaussian errors, in the vehicle's frame, of the stated sigmas on each
    axis of translation and rotation (as a rotation vector), and the slow drift besides.
    """
    poses = truth.world_from_vehicle
    steps = invert(poses[:-1]) @ poses[1:]
    slip_m = noise.odometry_translation_m * rng.standard_normal((len(steps), 3))
    turn_rad = noise.odometry_rotation_rad * rng.standard_normal((len(steps), 3))
    if drift is not None:
        slow = wander(np.diff(truth.timestamps_s), drift.correlation_s, 6, rng)
        slip_m += drift.translation_m * slow[:, :3]
        turn_rad += drift.rotation_rad * slow[:, 3:]
    return Trajectory(
        truth.timestamps_s, chain_steps(poses[0], steps @ make_pose(slip_m, Rotation.from_rotvec(turn_rad)))
    )


def wander(elapsed_s: FloatArray, correlation_s: float, axes: int, rng: np.random.Generator) -> FloatArray:
    """Draw Gauss-Markov processes of unit variance: (N, axes) for (N,) times elapsed since the value before."""
    keep = np.exp(-elapsed_s / correlation_s)
    draws = rng.standard_normal((len(elapsed_s), axes))
    values = draws.copy()
    for index in range(1, len(values)):
        values[index] = keep[index] * values[index - 1] + np.sqrt(1 - keep[index] ** 2) * draws[index]
    return values


def chain_steps(first: FloatArray, steps: FloatArray) -> FloatArray:
    """Multiply (N, 4, 4) relative poses onto a first one. Returns (N + 1, 4, 4), rotations kept orthonormal."""
    chain = np.empty((len(steps) + 1, 4, 4))
    chain[0] = first
    for index, step in enumerate(steps):
        chain[index + 1] = chain[index] @ step
    return make_pose(chain[:, :3, 3], Rotation.from_matrix(chain[:, :3, :3]))


def simulate_navigation(truth: Trajectory, noise: SensorNoise, rng: np.random.Generator) -> Navigation:
    """Read depth, roll and pitch of the vehicle at every stamp with Gaussian errors of the stated sigmas.

    Roll stays within half a turn and pitch within a quarter, as an attitude sensor reports them.
    """
    poses = truth.world_from_vehicle
    errors = rng.standard_normal((3, len(poses)))
    roll_rad, pitch_rad = measure_tilt(poses)
    noisy_roll_rad = roll_rad + noise.navigation_roll_rad * errors[1]
    return Navigation(
        truth.timestamps_s,
        poses[:, 2, 3] + noise.navigation_z_m * errors[0],
        np.where(
            np.abs(noisy_roll_rad) > np.pi, np.remainder(noisy_roll_rad + np.pi, 2 * np.pi) - np.pi, noisy_roll_rad
        ),
        np.clip(pitch_rad + noise.navigation_pitch_rad * errors[2], -np.pi / 2, np.pi / 2),
    )


def measure_tilt(world_from_vehicle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Give roll and pitch, (N,) each, of (N, 4, 4) poses whose rotation is Rz(yaw) Ry(pitch) Rx(roll).

    The lowest row of the rotation, (-sin pitch, cos pitch sin roll, cos pitch cos roll), is what gravity shows. Where
    the nose points straight up or down gravity says nothing of roll, which is then 0.
    """
    ahead, aside, up = world_from_vehicle[:, 2, :3].T
    level = np.hypot(aside, up)
    roll_rad = np.where(level > UPRIGHT, np.arctan2(aside, up), 0.0)
    return np.asarray(roll_rad), np.asarray(np.arctan2(-ahead, level))
