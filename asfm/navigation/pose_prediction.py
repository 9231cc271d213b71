"""Pose prediction from odometry, with the uncertainty that its steps accumulate between two frames."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from asfm.geometry.poses import invert
from asfm.navigation.frame_navigation import FrameNavigation
from asfm.sequence import Sequence
from asfm.types import FloatArray


@dataclass(frozen=True)
class PosePrediction:
    """Predicted poses of the sonar at the frame times, and the uncertainty of one step."""

    world_from_sonar: FloatArray
    """(N, 4, 4)"""
    step_rotation_rad: float
    """Standard deviation of one step's rotation, each axis."""
    step_translation_m: float
    """Standard deviation of one step's translation, each axis."""

    def relative_pose(self, frame_a: int, frame_b: int) -> FloatArray:
        """Return the (4, 4) relative pose b_from_a of two frames' sonars."""
        return np.asarray(self._sonar_from_world[frame_b] @ self.world_from_sonar[frame_a])

    @cached_property
    def _sonar_from_world(self) -> FloatArray:
        return invert(self.world_from_sonar)

    def predicted_sigma(self, frame_a: int, frame_b: int, range_m: FloatArray, sigma: FloatArray) -> FloatArray:
        """Combine the uncertainty of the relative pose with the noise of measured points.

        The errors of the steps are independent (a random walk), so they grow with the root of the number of steps. A
        translation error shifts the range, and the bearing by its size over the range; a rotation error the bearing.

        Args:
            frame_a: one frame.
            frame_b: the other frame.
            range_m: (K,) ranges of points.
            sigma: (2,) standard deviations of range_m and bearing_rad under exact poses.

        Returns:
            (K, 2) standard deviations of range_m and bearing_rad; that of the bearing is at most pi.
        """
        root = np.sqrt(abs(frame_b - frame_a))
        shift_m, turn_rad = root * self.step_translation_m, root * self.step_rotation_rad
        across_rad = shift_m / np.maximum(range_m, 1e-9)
        bearing_rad = np.minimum(np.sqrt(sigma[1] ** 2 + turn_rad**2 + across_rad**2), np.pi)
        return np.stack([np.full(len(range_m), np.hypot(sigma[0], shift_m)), bearing_rad], axis=1)


def predict_poses(navigation: FrameNavigation, sequence: Sequence) -> PosePrediction | None:
    """Predict the sonar's poses from the odometry; None without odometry.

    Args:
        navigation: odometry at the frame times.
        sequence: the sonar's lever arm, and the stated noise of the odometry.
    """
    if navigation.odometry is None:
        return None
    noise, lever_m = sequence.noise, float(np.linalg.norm(sequence.vehicle_from_sonar[:3, 3]))
    return PosePrediction(
        navigation.odometry.world_from_vehicle @ sequence.vehicle_from_sonar,
        noise.odometry_rotation_rad,
        float(np.hypot(noise.odometry_translation_m, lever_m * noise.odometry_rotation_rad)),
    )
