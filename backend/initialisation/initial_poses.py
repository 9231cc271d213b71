"""Where the poses start and what holds them: odometry, or a chain of planar motions and a weak prior."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.backend.initialisation.planar_odometry import planar_odometry
from asfm.config import Config
from asfm.geometry.poses import chain_steps, make_pose, steps_between
from asfm.navigation.frame_navigation import FrameNavigation
from asfm.navigation.odometry_check import (
    OdometryTest,
    compare_odometry_hypotheses,
    diagnose_odometry,
    diagnose_time_offset,
    measure_disagreement,
    resolve_attitude_conflict,
)
from asfm.navigation.odometry_hypotheses import PointPairs, odometry_hypotheses, planar_inliers
from asfm.navigation.sensor_consistency import align_initial_attitude, estimate_time_offset
from asfm.navigation.sensor_constraints import (
    UNRELIABLE_SIGMA_FACTOR,
    SensorConstraints,
    level_pose,
    sensor_constraints,
)
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, Tracks

LEAST_STEP = (1e-3, 1e-3)
"""Floor of the motion prior's sigmas: rad, and metres per metre of range."""


@dataclass(frozen=True)
class InitialPoses:
    """Initial poses, and the constraints between and on them."""

    world_from_vehicle: FloatArray
    """(N, 4, 4)"""
    sensors: SensorConstraints
    unreliable: BoolArray
    """(N - 1,) which steps of the initial poses are not worth starting from."""


def initialise_from_odometry(navigation: FrameNavigation, sequence: Sequence) -> InitialPoses | None:
    """Start from the odometry; None where there is none or it is not used."""
    odometry = navigation.odometry
    if odometry is None:
        return None
    poses = odometry.world_from_vehicle
    sensors = sensor_constraints(sequence, navigation, poses, odometry.step_sigma, measured=True)
    return InitialPoses(poses, sensors, odometry.unreliable)


def verify_odometry(
    start: InitialPoses, sequence: Sequence, point_pairs: list[PointPairs], config: Config, rng: np.random.Generator
) -> InitialPoses:
    """Hold odometry against the images and against navigation, and make vague what they contradict."""
    kept = [seen for seen in point_pairs if not start.unreliable[seen.frame_a : seen.frame_b].any()]
    agreed = planar_inliers(kept, rng)
    poses, sensors = start.world_from_vehicle, start.sensors
    test = compare_odometry_hypotheses(poses, sensors, agreed, sequence, config)
    shift = estimate_time_offset(poses, sensors.depth_attitude, sequence.noise)
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
    depth_attitude = sensors.depth_attitude
    undone, _ = align_initial_attitude(undone, depth_attitude, sequence.noise, np.ones(3, dtype=bool))
    sigma = UNRELIABLE_SIGMA_FACTOR * sensors.step_sigma
    sensors = replace(
        sensors,
        first_pose=undone[0],
        steps=steps_between(undone),
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
    replaced = (start.unreliable & supported[1:])[:, None, None]
    mended = chain_steps(poses[0], np.where(replaced, steps_between(chain), steps_between(poses)))
    rotation = Rotation.from_matrix(mended[:, :3, :3])
    depth_attitude = start.sensors.depth_attitude
    trusted = np.full(3, bool(start.unreliable.all()))
    placed, _ = align_initial_attitude(make_pose(mended[:, :3, 3], rotation), depth_attitude, sequence.noise, trusted)
    return InitialPoses(placed, replace(start.sensors, first_pose=placed[0]), start.unreliable)


def initialise_from_tracks(
    navigation: FrameNavigation, sequence: Sequence, tracks: Tracks, config: Config, rng: np.random.Generator
) -> InitialPoses:
    """Start from planar motions between frames that share tracks.

    The planar odometry is not a measurement: it is made from the same tracks. Where the tracks do not constrain the
    poses, the motion prior does: each step is zero with a sigma of a few typical steps of the planar odometry.

    Args:
        navigation: depth and attitude at the frames.
        sequence: gives the sonar and its lever arm.
        tracks: joined without knowledge of the poses.
        config: section ``backend``.
        rng: draws the trial motions.
    """
    readings = navigation.depth_attitude.z_roll_pitch
    first_pose = level_pose(readings[0]) if len(readings) else np.eye(4)
    poses, moved = planar_odometry(tracks, len(sequence), first_pose, sequence.vehicle_from_sonar, rng)
    farthest_m = float(sequence.sonar.range_edges_m[-1])
    sigma = config.backend.motion_prior_factor * np.maximum(
        _typical_step(poses, moved), [LEAST_STEP[0], LEAST_STEP[1] * farthest_m]
    )
    held = np.repeat(poses[:1], len(poses), axis=0)
    step_sigma = np.tile(sigma, (len(poses) - 1, 1))
    sensors = sensor_constraints(sequence, navigation, held, step_sigma, measured=False)
    return InitialPoses(poses, sensors, np.zeros(len(step_sigma), dtype=bool))


def _typical_step(world_from_vehicle: FloatArray, moved: BoolArray) -> FloatArray:
    """Root mean square (2,) of the rotation in rad and translation in m, each axis, of the steps that moved."""
    steps = steps_between(world_from_vehicle)[moved[1:]]
    if not len(steps):
        return np.zeros(2)
    rotation_rad = Rotation.from_matrix(steps[:, :3, :3]).as_rotvec()
    return np.sqrt([np.mean(rotation_rad**2), np.mean(steps[:, :3, 3] ** 2)])
