"""Where the poses start and what holds them: odometry, or a chain of planar motions and a weak prior."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.backend.initialisation.planar_odometry import planar_odometry
from asfm.config import Config
from asfm.geometry.poses import invert, make_pose
from asfm.navigation.depth_attitude import DepthAttitude, interpolate_depth_attitude
from asfm.navigation.odometry import read_odometry
from asfm.navigation.odometry_check import (
    OdometryTest,
    compare_odometry_hypotheses,
    diagnose_odometry,
    diagnose_time_offset,
    measure_disagreement,
    resolve_attitude_conflict,
)
from asfm.navigation.odometry_hypotheses import PointPairs, odometry_hypotheses, planar_inliers
from asfm.navigation.sensor_consistency import align_initial_attitude, compare_odometry_attitude, estimate_time_offset
from asfm.navigation.sensor_constraints import (
    SensorConstraints,
    level_pose,
    navigation_at_frames,
    sensor_constraints,
)
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, Tracks, Trajectory

LEAST_STEP = (1e-3, 1e-3)
"""Floor of the motion prior's sigmas: rad, and metres per metre of range."""


UNRELIABLE_SIGMA_FACTOR = 2.0
"""Sigmas of an odometry whose fault was undone, over those stated."""


@dataclass(frozen=True)
class InitialPoses:
    """Initial poses, and the constraints between and on them."""

    world_from_vehicle: FloatArray
    """(N, 4, 4)"""
    sensors: SensorConstraints
    unreliable: BoolArray
    """(N - 1,) which steps of the initial poses are not worth starting from."""


def initialise_from_odometry(sequence: Sequence, config: Config) -> InitialPoses | None:
    """Start from the odometry, or give None where there is none or it is not wanted."""
    odometry = read_odometry(sequence, config.backend)
    if odometry is None:
        return None
    poses, noise = odometry.world_from_vehicle, sequence.noise
    depth_attitude = interpolate_depth_attitude(sequence, config.backend, Trajectory(sequence.timestamps_s, poses))
    trusted = ~compare_odometry_attitude(poses, depth_attitude, noise).contradicts
    poses, moved = align_initial_attitude(poses, depth_attitude, noise, trusted)
    diagnostics = (*odometry.diagnostics, *moved)
    sensors = sensor_constraints(sequence, config.backend, poses, odometry.step_sigma, True, diagnostics)
    return InitialPoses(poses, sensors, odometry.unreliable)


def verify_odometry(
    start: InitialPoses, sequence: Sequence, point_pairs: list[PointPairs], config: Config, rng: np.random.Generator
) -> InitialPoses:
    """Hold odometry against the images and against navigation, and make vague what they contradict."""
    kept = [seen for seen in point_pairs if not start.unreliable[seen.frame_a : seen.frame_b].any()]
    agreed = planar_inliers(kept, rng)
    poses, sensors = start.world_from_vehicle, start.sensors
    test = compare_odometry_hypotheses(poses, sensors, agreed, sequence, config)
    shift = estimate_time_offset(poses, DepthAttitude(sensors.z_roll_pitch, sensors.z_roll_pitch_sigma), sequence.noise)
    contradicted = test is not None and test.contradicted
    if not agreed or not (contradicted or shift):
        return InitialPoses(*resolve_attitude_conflict(poses, sensors, agreed, sequence), start.unreliable)
    if test is not None and contradicted and test.likely:
        return _undo_fault(start, test, sequence)
    sigma = measure_disagreement(poses, agreed, sequence.vehicle_from_sonar)
    found = [diagnose_odometry(test, sigma)] if test is not None and contradicted else []
    if shift:
        found.append(diagnose_time_offset(shift * float(np.median(np.diff(sequence.timestamps_s))), sigma))
    sensors = replace(
        sensors, step_sigma=np.hypot(sensors.step_sigma, sigma), diagnostics=(*sensors.diagnostics, *found)
    )
    return InitialPoses(poses, sensors, np.ones(len(start.unreliable), dtype=bool))


def _undo_fault(start: InitialPoses, test: OdometryTest, sequence: Sequence) -> InitialPoses:
    """Take odometry as it would be without the fault that explains the images, and believe it half as much."""
    sensors, lever = start.sensors, sequence.vehicle_from_sonar
    undone = odometry_hypotheses(start.world_from_vehicle, lever)[str(test.likely)]
    depth_attitude = DepthAttitude(sensors.z_roll_pitch, sensors.z_roll_pitch_sigma)
    undone, _ = align_initial_attitude(undone, depth_attitude, sequence.noise, np.ones(3, dtype=bool))
    sigma = UNRELIABLE_SIGMA_FACTOR * sensors.step_sigma
    sensors = replace(
        sensors,
        first_pose=undone[0],
        steps=invert(undone[:-1]) @ undone[1:],
        step_sigma=sigma,
        diagnostics=(*sensors.diagnostics, diagnose_odometry(test, np.median(sigma, axis=0))),
    )
    return InitialPoses(undone, sensors, start.unreliable)


def replace_unreliable_steps(
    start: InitialPoses, sequence: Sequence, tracks: Tracks, rng: np.random.Generator
) -> InitialPoses:
    """Put planar motions in the place of the steps that are not worth starting from.

    Args:
        tracks: joined without knowledge of the poses.
    """
    poses = start.world_from_vehicle
    chain, supported = planar_odometry(tracks, len(poses), poses[0], sequence.vehicle_from_sonar, rng)
    steps = invert(poses[:-1]) @ poses[1:]
    shown = invert(chain[:-1]) @ chain[1:]
    steps = np.where((start.unreliable & supported[1:])[:, None, None], shown, steps)
    mended = [poses[0]]
    for step in steps:
        mended.append(mended[-1] @ step)
    rotation = Rotation.from_matrix(np.stack(mended)[:, :3, :3])
    depth_attitude = DepthAttitude(start.sensors.z_roll_pitch, start.sensors.z_roll_pitch_sigma)
    trusted = np.full(3, bool(start.unreliable.all()))
    placed, _ = align_initial_attitude(
        make_pose(np.stack(mended)[:, :3, 3], rotation), depth_attitude, sequence.noise, trusted
    )
    return InitialPoses(placed, replace(start.sensors, first_pose=placed[0]), start.unreliable)


def initialise_from_tracks(
    sequence: Sequence, tracks: Tracks, config: Config, rng: np.random.Generator
) -> InitialPoses:
    """Start from planar motions between frames that share tracks.

    The chain is not a measurement, it was made from the same tracks. What holds the poses where the tracks do not is
    the prior that the vehicle moves little: each step is zero with a sigma of a few typical steps of the chain.

    Args:
        tracks: joined without knowledge of the poses.
    """
    navigation = navigation_at_frames(sequence, config.backend)
    first_pose = level_pose(navigation[0]) if len(navigation) else np.eye(4)
    poses, moved = planar_odometry(tracks, len(sequence), first_pose, sequence.vehicle_from_sonar, rng)
    farthest_m = float(sequence.sonar.range_edges_m[-1])
    sigma = config.backend.motion_prior_factor * np.maximum(
        _typical_step(poses, moved), [LEAST_STEP[0], LEAST_STEP[1] * farthest_m]
    )
    held = np.repeat(poses[:1], len(poses), axis=0)
    step_sigma = np.tile(sigma, (len(poses) - 1, 1))
    sensors = sensor_constraints(sequence, config.backend, held, step_sigma, measured=False)
    return InitialPoses(poses, sensors, np.zeros(len(step_sigma), dtype=bool))


def _typical_step(world_from_vehicle: FloatArray, moved: BoolArray) -> FloatArray:
    """Root mean square (2,) of the rotation in rad and translation in m, each axis, of the steps that moved."""
    steps = (invert(world_from_vehicle[:-1]) @ world_from_vehicle[1:])[moved[1:]]
    if not len(steps):
        return np.zeros(2)
    rotation_rad = Rotation.from_matrix(steps[:, :3, :3]).as_rotvec()
    return np.sqrt([np.mean(rotation_rad**2), np.mean(steps[:, :3, 3] ** 2)])
