"""Odometry, depth and attitude as constraints on the poses at the frame times."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.diagnostics import Diagnostic
from asfm.geometry.poses import depth_roll_pitch, make_pose, steps_between, wrap_angle
from asfm.navigation.depth_attitude import DepthAttitude
from asfm.navigation.frame_navigation import FrameNavigation
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, SensorNoise

FIXED_SIGMA = 1e-6
"""Standard deviation, in rad and m, of what defines the world frame."""
UNRELIABLE_SIGMA_FACTOR = 2.0
"""Sigmas of odometry that was corrected for a fault, over the stated ones."""
DRIFT_SIGMAS = 3.0
"""The first pose of the odometry has drifted where it differs from the first reading by so many of its sigmas."""


@dataclass(frozen=True)
class SensorConstraints:
    """Constraints between and on the poses of N frames, from sensors other than the sonar."""

    first_pose: FloatArray
    """(4, 4) world_from_vehicle of the first frame."""
    first_sigma: FloatArray
    """(6,) standard deviations of the first pose: rotation in rad, then translation in m, in the world's axes."""
    measured: bool
    """Whether the steps come from odometry; otherwise they are a motion prior."""
    steps: FloatArray
    """(N - 1, 4, 4) motion from each frame to the next, in the frame of the former."""
    step_sigma: FloatArray
    """(N - 1, 2) standard deviations of the rotation in rad and of the translation in m, each axis."""
    z_roll_pitch: FloatArray
    """(N, 3) metres and radians, or (0, 3) without navigation."""
    z_roll_pitch_sigma: FloatArray
    """(N, 3) or (0, 3) standard deviations in metres and radians; infinite where nothing was measured."""
    diagnostics: tuple[Diagnostic, ...] = ()
    """What is wrong with the readings."""
    standstill: BoolArray | None = None
    """(N - 1,) steps of a motion prior during which no motion is seen; None where that was not examined."""

    def known_steps(self, noise: SensorNoise) -> BoolArray:
        """Return which steps odometry measured about as well as its stated noise, shape (N - 1,); none for a prior."""
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
        """Median standard deviation of a step's rotation; 0 where there is no step."""
        return float(np.median(self.step_sigma[:, 0])) if len(self.step_sigma) else 0.0


def sensor_constraints(
    sequence: Sequence,
    navigation: FrameNavigation,
    world_from_vehicle: FloatArray,
    step_sigma: FloatArray,
    measured: bool,
) -> SensorConstraints:
    """Turn steps, depth and attitude into constraints between and on the poses.

    Where navigation measures height, roll and pitch, the first pose is as uncertain in these as the sensors are;
    position, heading and everything else is fixed there and defines the world frame.

    Args:
        sequence: states the noise of its sensors.
        navigation: depth and attitude at the frame times.
        world_from_vehicle: (N, 4, 4) poses whose steps are the constraints: odometry or a motion prior.
        step_sigma: (N - 1, 2) standard deviations of the steps' rotation in rad and translation in m, each axis.
        measured: whether the poses are odometry.
    """
    noise, readings = sequence.noise, navigation.depth_attitude
    angle_rad = float(np.hypot(noise.navigation_roll_rad, noise.navigation_pitch_rad) / np.sqrt(2))
    first_sigma = np.full(6, FIXED_SIGMA)
    if len(readings.sigma):
        first_sigma[[0, 1, 5]] = angle_rad, angle_rad, noise.navigation_z_m
        first_sigma = _admit_drift(first_sigma, world_from_vehicle[0], readings)
    return SensorConstraints(
        first_pose=world_from_vehicle[0],
        first_sigma=first_sigma,
        measured=measured,
        steps=steps_between(world_from_vehicle),
        step_sigma=step_sigma,
        z_roll_pitch=readings.z_roll_pitch,
        z_roll_pitch_sigma=readings.sigma,
        diagnostics=navigation.diagnostics,
    )


def _admit_drift(first_sigma: FloatArray, world_from_vehicle: FloatArray, readings: DepthAttitude) -> FloatArray:
    """Return the (6,) sigmas of the first pose, widened where it lies far from the first reading.

    Odometry that was running before the first frame has drifted by then; the readings have not.

    Args:
        first_sigma: (6,) as uncertain as the sensors are.
        world_from_vehicle: (4, 4) first pose.
        readings: depth and attitude at the frames.
    """
    z_m, roll_rad, pitch_rad = depth_roll_pitch(world_from_vehicle[None])[0] - readings.z_roll_pitch[0]
    measured = np.isfinite(readings.sigma[0])
    angle_rad = float(np.max(np.abs(wrap_angle(np.array([roll_rad, pitch_rad])))[measured[1:]], initial=0.0))
    apart = np.zeros(6)
    apart[[0, 1, 5]] = angle_rad, angle_rad, abs(z_m) if measured[0] else 0.0
    return np.where(apart > DRIFT_SIGMAS * first_sigma, apart, first_sigma)


def level_pose(z_roll_pitch: FloatArray) -> FloatArray:
    """Return the (4, 4) pose with x = y = heading = 0 and the (3,) height, roll and pitch of a reading, m and rad."""
    z_m, roll_rad, pitch_rad = z_roll_pitch
    return make_pose(np.array([0.0, 0.0, z_m]), Rotation.from_euler("ZYX", [0.0, pitch_rad, roll_rad]))
