"""What is known of the poses without the sonar: steps, depth and attitude at the frames' stamps."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.config import BackendConfig
from asfm.diagnostics import Diagnostic
from asfm.geometry.poses import invert, make_pose
from asfm.navigation.depth_attitude import interpolate_depth_attitude
from asfm.navigation.odometry import read_odometry
from asfm.sequence import Sequence
from asfm.types import FloatArray, Trajectory

TIGHT = 1e-6


@dataclass(frozen=True)
class SensorConstraints:
    """Sensor readings turned into constraints between and on the frames' poses."""

    first_pose: FloatArray
    """(4, 4) where the world puts the first frame's vehicle."""
    first_covariance: FloatArray
    """(6, 6) rotation, translation in the vehicle's frame: how firmly (GTSAM's order)."""
    measured: bool
    """Whether the steps come from odometry; else they are a guess."""
    steps: FloatArray
    """(N - 1, 4, 4) motion from each frame to the next."""
    step_sigma: FloatArray
    """(N - 1, 2) standard deviations of the rotation in rad and of the translation in m, each axis."""
    z_roll_pitch: FloatArray
    """(N, 3) metres and radians, or (0, 3) without navigation."""
    z_roll_pitch_sigma: FloatArray
    """(N, 3) or (0, 3) standard deviations in metres and radians; infinite where nothing was measured."""
    diagnostics: tuple[Diagnostic, ...] = ()
    """What is wrong with the readings."""

    @property
    def typical_rotation_rad(self) -> float:
        """How uncertain a step's rotation is, in the median; 0 where there is no step."""
        return float(np.median(self.step_sigma[:, 0])) if len(self.step_sigma) else 0.0


def odometry_at_frames(sequence: Sequence, config: BackendConfig) -> FloatArray | None:
    """Interpolate the odometry at the frames' stamps: (N, 4, 4), or None where there is none or it is not wanted."""
    odometry = read_odometry(sequence, config)
    return None if odometry is None else odometry.world_from_vehicle


def navigation_at_frames(sequence: Sequence, config: BackendConfig) -> FloatArray:
    """Interpolate depth and attitude at the frames' stamps: (N, 3) z_m, roll_rad, pitch_rad; (0, 3) without."""
    return interpolate_depth_attitude(sequence, config).z_roll_pitch


def sensor_constraints(
    sequence: Sequence,
    config: BackendConfig,
    world_from_vehicle: FloatArray,
    step_sigma: FloatArray,
    measured: bool,
    diagnostics: tuple[Diagnostic, ...] = (),
) -> SensorConstraints:
    """Gather the constraints.

    Args:
        world_from_vehicle: (N, 4, 4) the odometry at the frames, or what stands in for it.
        step_sigma: (N - 1, 2) standard deviations of its steps' rotation in rad and translation in m.
        measured: whether it is odometry.
        diagnostics: what is wrong with it.
    """
    depth_attitude = interpolate_depth_attitude(
        sequence, config, Trajectory(sequence.timestamps_s, world_from_vehicle) if measured else None
    )
    noise = sequence.noise
    angle_rad = float(np.hypot(noise.navigation_roll_rad, noise.navigation_pitch_rad) / np.sqrt(2))
    world_sigma = np.full(6, TIGHT)
    if len(depth_attitude.sigma):
        world_sigma[[0, 1, 5]] = angle_rad, angle_rad, noise.navigation_z_m
    rotation = np.zeros((6, 6))
    rotation[:3, :3] = rotation[3:, 3:] = world_from_vehicle[0, :3, :3].T
    return SensorConstraints(
        first_pose=world_from_vehicle[0],
        first_covariance=rotation @ np.diag(world_sigma**2) @ rotation.T,
        measured=measured,
        steps=invert(world_from_vehicle[:-1]) @ world_from_vehicle[1:],
        step_sigma=step_sigma,
        z_roll_pitch=depth_attitude.z_roll_pitch,
        z_roll_pitch_sigma=depth_attitude.sigma,
        diagnostics=(*diagnostics, *depth_attitude.diagnostics),
    )


def level_pose(z_roll_pitch: FloatArray) -> FloatArray:
    """Make (4, 4) a pose at the origin with heading zero and the depth and attitude of one reading (3,)."""
    z_m, roll_rad, pitch_rad = z_roll_pitch
    return make_pose(np.array([0.0, 0.0, z_m]), Rotation.from_euler("ZYX", [0.0, pitch_rad, roll_rad]))
