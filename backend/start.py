"""Where the poses start and what holds them: odometry, or a chain of planar motions and a weak prior."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.backend.motion import chain_planar_motions
from asfm.backend.odometry import read_odometry
from asfm.backend.sensors import (
    SensorConstraints,
    level_pose,
    navigation_at_frames,
    sensor_constraints,
)
from asfm.config import Config
from asfm.poses import invert
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, Tracks

LEAST_STEP = (1e-3, 1e-3)
"""Floor of the motion prior's sigmas: rad, and metres per metre of range."""


@dataclass(frozen=True)
class Start:
    """Initial poses, and the constraints between and on them."""

    world_from_vehicle: FloatArray
    """(N, 4, 4)"""
    sensors: SensorConstraints


def start_from_odometry(sequence: Sequence, config: Config) -> Start | None:
    """Start from the odometry, or give None where there is none or it is not wanted."""
    odometry = read_odometry(sequence, config.backend)
    if odometry is None:
        return None
    poses = odometry.world_from_vehicle
    return Start(
        poses, sensor_constraints(sequence, config.backend, poses, odometry.step_sigma, True, odometry.warnings)
    )


def start_from_tracks(sequence: Sequence, tracks: Tracks, config: Config, rng: np.random.Generator) -> Start:
    """Start from planar motions between frames that share tracks.

    The chain is not a measurement, it was made from the same tracks. What holds the poses where the tracks do not is
    the prior that the vehicle moves little: each step is zero with a sigma of a few typical steps of the chain.

    Args:
        tracks: joined without knowledge of the poses.
    """
    navigation = navigation_at_frames(sequence, config.backend)
    first_pose = level_pose(navigation[0]) if len(navigation) else np.eye(4)
    poses, moved = chain_planar_motions(tracks, len(sequence), first_pose, sequence.vehicle_from_sonar, rng)
    farthest_m = float(sequence.sonar.range_edges_m[-1])
    sigma = config.backend.motion_prior_factor * np.maximum(
        _typical_step(poses, moved), [LEAST_STEP[0], LEAST_STEP[1] * farthest_m]
    )
    held = np.repeat(poses[:1], len(poses), axis=0)
    step_sigma = np.tile(sigma, (len(poses) - 1, 1))
    return Start(poses, sensor_constraints(sequence, config.backend, held, step_sigma, measured=False))


def _typical_step(world_from_vehicle: FloatArray, moved: BoolArray) -> FloatArray:
    """Root mean square (2,) of the rotation in rad and translation in m, each axis, of the steps that moved."""
    steps = (invert(world_from_vehicle[:-1]) @ world_from_vehicle[1:])[moved[1:]]
    if not len(steps):
        return np.zeros(2)
    rotation_rad = Rotation.from_matrix(steps[:, :3, :3]).as_rotvec()
    return np.sqrt([np.mean(rotation_rad**2), np.mean(steps[:, :3, 3] ** 2)])
