"""Sensor constraints: odometry steps, depth and attitude as constraints on the poses at the frames."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.diagnostics import Diagnostic
from asfm.geometry.poses import make_pose, steps_between
from asfm.navigation.depth_attitude import DepthAttitude
from asfm.navigation.frame_navigation import FrameNavigation
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, SensorNoise

TIGHT = 1e-6
UNRELIABLE_SIGMA_FACTOR = 2.0
"""Sigmas of an odometry that was corrected for a fault, over those stated."""


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

    def known_steps(self, noise: SensorNoise) -> BoolArray:
        """Return which (N - 1,) steps odometry measured about as well as its stated noise; none where it is a guess."""
        if not self.measured:
            return np.zeros(len(self.step_sigma), dtype=bool)
        stated = np.array([noise.odometry_rotation_rad, noise.odometry_translation_m])
        return np.asarray((self.step_sigma <= UNRELIABLE_SIGMA_FACTOR * stated).all(axis=1))

    @property
    def depth_attitude(self) -> DepthAttitude:
        """Depth and attitude at the frames, without their diagnostics."""
        return DepthAttitude(self.z_roll_pitch, self.z_roll_pitch_sigma)

    @property
    def typical_rotation_rad(self) -> float:
        """How uncertain a step's rotation is, in the median; 0 where there is no step."""
        return float(np.median(self.step_sigma[:, 0])) if len(self.step_sigma) else 0.0


def sensor_constraints(
    sequence: Sequence,
    navigation: FrameNavigation,
    world_from_vehicle: FloatArray,
    step_sigma: FloatArray,
    measured: bool,
) -> SensorConstraints:
    """Turn steps, depth and attitude into constraints between and on the poses.

    Args:
        sequence: states the noise of its sensors.
        navigation: depth and attitude at the frames.
        world_from_vehicle: (N, 4, 4) the odometry at the frames, or what stands in for it.
        step_sigma: (N - 1, 2) standard deviations of its steps' rotation in rad and translation in m.
        measured: whether it is odometry.
    """
    noise, readings = sequence.noise, navigation.depth_attitude
    angle_rad = float(np.hypot(noise.navigation_roll_rad, noise.navigation_pitch_rad) / np.sqrt(2))
    world_sigma = np.full(6, TIGHT)
    if len(readings.sigma):
        world_sigma[[0, 1, 5]] = angle_rad, angle_rad, noise.navigation_z_m
    rotation = np.zeros((6, 6))
    rotation[:3, :3] = rotation[3:, 3:] = world_from_vehicle[0, :3, :3].T
    return SensorConstraints(
        first_pose=world_from_vehicle[0],
        first_covariance=rotation @ np.diag(world_sigma**2) @ rotation.T,
        measured=measured,
        steps=steps_between(world_from_vehicle),
        step_sigma=step_sigma,
        z_roll_pitch=readings.z_roll_pitch,
        z_roll_pitch_sigma=readings.sigma,
        diagnostics=navigation.diagnostics,
    )


def level_pose(z_roll_pitch: FloatArray) -> FloatArray:
    """Make (4, 4) a pose at the origin with heading zero and the depth and attitude of one reading (3,)."""
    z_m, roll_rad, pitch_rad = z_roll_pitch
    return make_pose(np.array([0.0, 0.0, z_m]), Rotation.from_euler("ZYX", [0.0, pitch_rad, roll_rad]))
