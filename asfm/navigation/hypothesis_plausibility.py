"""Plausibility of fault hypotheses that explain the images equally well: agreement with depth and attitude, view."""

from collections.abc import Sequence as Rows

import numpy as np

from asfm.config import Scene
from asfm.navigation.depth_attitude import DepthAttitude
from asfm.navigation.fault_hypotheses import Hypothesis
from asfm.navigation.sensor_consistency import compare_odometry_attitude
from asfm.sequence import Sequence
from asfm.types import FloatArray

LEVEL_SINE = 0.1
"""A view within this sine of the horizontal is neither up nor down."""


def sort_by_plausibility(
    hypotheses: Rows[Hypothesis], depth_attitude: DepthAttitude, sequence: Sequence, scene: Scene
) -> list[Hypothesis]:
    """Sort hypotheses, the likeliest first; equally plausible ones keep their order.

    Hypotheses under which odometry contradicts depth or attitude come later, in the order of the number of channels.
    Next come those under which the sonar looks away from the scene, because sonars usually look at the bottom.

    Args:
        hypotheses: poses and signs of the readings.
        depth_attitude: readings at the same frames.
        sequence: gives the lever arm and the stated noise.
        scene: known side of the sonar on which the scene lies; below where it is unknown.
    """

    def rank(hypothesis: Hypothesis) -> tuple[int, bool]:
        poses = hypothesis.world_from_vehicle
        known = np.isfinite(poses).all(axis=(1, 2))
        signs = np.asarray(hypothesis.reading_signs)
        conflicts = 0
        if len(depth_attitude.sigma):
            readings = DepthAttitude(depth_attitude.z_roll_pitch[known] * signs, depth_attitude.sigma[known])
            conflicts = int(compare_odometry_attitude(poses[known], readings, sequence.noise).contradicts.sum())
        upward = _upward_sine(poses[known], sequence.vehicle_from_sonar) * (-1 if scene == "above" else 1)
        return conflicts, upward > LEVEL_SINE

    return sorted(hypotheses, key=rank)


def _upward_sine(world_from_vehicle: FloatArray, vehicle_from_sonar: FloatArray) -> float:
    """Return the median sine of the elevation at which the sonar looks in the world."""
    return float(np.median((world_from_vehicle @ vehicle_from_sonar)[:, 2, 0])) if len(world_from_vehicle) else 0.0
