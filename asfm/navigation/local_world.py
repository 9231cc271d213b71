"""Local world of a sequence: odometry, depth and true poses about a local origin."""

from dataclasses import replace

import numpy as np

from asfm.config import BackendConfig
from asfm.geometry.local_origin import local_origin, shift_trajectory
from asfm.sequence import Sequence
from asfm.types import FloatArray

ROUNDING_DECIMALS = 6
"""Without odometry depths are rounded to a micrometre about their origin. The images then decide the motion, and their
nonlinear adjustment turns the last digits of the depths, which an offset changes, into tens of micrometres."""


def move_to_local_origin(sequence: Sequence, config: BackendConfig) -> tuple[Sequence, FloatArray]:
    """Move the world of a sequence to a local origin, near which all estimation works.

    One offset is taken off odometry, depth and true poses, so that what they say about each other does not change. Its
    x and y are those of the odometry, its z that of the depths or else of the odometry; they are zero for sensors that
    are not used: such a run defines its world itself.

    Args:
        sequence: odometry, depth and true poses.
        config: which sensors are used.

    Returns:
        The sequence about the origin, and the origin (3,) in the world.
    """
    odometry, navigation = sequence.odometry, sequence.navigation
    by_odometry = odometry is not None and config.use_odometry
    by_depth = navigation is not None and config.use_navigation and len(navigation.z_m) > 0
    origin_m = np.zeros(3)
    if odometry is not None and by_odometry:
        origin_m = local_origin(odometry.world_from_vehicle[:, :3, 3])
    if navigation is not None and by_depth:
        z_m = navigation.z_m
        origin_m[2] = local_origin(z_m[:, None])[0] if by_odometry else np.sort(z_m)[(len(z_m) - 1) // 2]
        local_m = z_m - origin_m[2]
        navigation = replace(navigation, z_m=local_m if by_odometry else np.round(local_m, ROUNDING_DECIMALS))
    return replace(shift_poses_of(sequence, -origin_m), navigation=navigation), origin_m


def shift_poses_of(sequence: Sequence, offset_m: FloatArray) -> Sequence:
    """Add an offset (3,) to the positions of a sequence's odometry and true poses."""
    odometry, truth = sequence.odometry, sequence.groundtruth
    return replace(
        sequence,
        odometry=None if odometry is None else shift_trajectory(odometry, offset_m),
        groundtruth=None if truth is None else shift_trajectory(truth, offset_m),
    )


def with_world_of(sequence: Sequence, recorded: Sequence) -> Sequence:
    """Return the sequence, with its calibration, and the odometry, depth and true poses of another in their world."""
    return replace(
        sequence, odometry=recorded.odometry, navigation=recorded.navigation, groundtruth=recorded.groundtruth
    )
