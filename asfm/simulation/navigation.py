"""What the vehicle's own sensors report: drifting odometry, depth and attitude."""

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.poses import invert, make_pose
from asfm.types import FloatArray, Navigation, SensorNoise, Trajectory


def simulate_odometry(truth: Trajectory, noise: SensorNoise, rng: np.random.Generator) -> Trajectory:
    """Chain noisy steps, beginning at the true first pose.

    Every step between frames gets independent Gaussian errors, in the vehicle's frame, of the stated sigmas on each
    axis of translation and rotation (as a rotation vector).
    """
    poses = truth.world_from_vehicle
    steps = invert(poses[:-1]) @ poses[1:]
    slip_m = noise.odometry_translation_m * rng.standard_normal((len(steps), 3))
    turn_rad = noise.odometry_rotation_rad * rng.standard_normal((len(steps), 3))
    return Trajectory(
        truth.timestamps_s, chain_steps(poses[0], steps @ make_pose(slip_m, Rotation.from_rotvec(turn_rad)))
    )


def chain_steps(first: FloatArray, steps: FloatArray) -> FloatArray:
    """Multiply (N, 4, 4) relative poses onto a first one. Returns (N + 1, 4, 4), rotations kept orthonormal."""
    chain = np.empty((len(steps) + 1, 4, 4))
    chain[0] = first
    for index, step in enumerate(steps):
        chain[index + 1] = chain[index] @ step
    return make_pose(chain[:, :3, 3], Rotation.from_matrix(chain[:, :3, :3]))


def simulate_navigation(truth: Trajectory, noise: SensorNoise, rng: np.random.Generator) -> Navigation:
    """Read depth, roll and pitch of the vehicle at every stamp with Gaussian errors of the stated sigmas."""
    poses = truth.world_from_vehicle
    errors = rng.standard_normal((3, len(poses)))
    _, pitch_rad, roll_rad = Rotation.from_matrix(poses[:, :3, :3]).as_euler("ZYX").T
    return Navigation(
        truth.timestamps_s,
        poses[:, 2, 3] + noise.navigation_z_m * errors[0],
        roll_rad + noise.navigation_roll_rad * errors[1],
        pitch_rad + noise.navigation_pitch_rad * errors[2],
    )
