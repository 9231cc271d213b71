"""Initial poses and their constraints, from odometry or from planar odometry with a weak motion prior."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from asfm.backend.initialisation.planar_odometry import planar_odometry
from asfm.backend.initialisation.pose_search import search_poses
from asfm.backend.initialisation.standstill import diagnose_standstill, find_standstill, standstill_sigma
from asfm.backend.initialisation.typical_steps import typical_steps
from asfm.config import Config
from asfm.geometry.feature_noise import observation_sigma
from asfm.geometry.poses import chain_steps, invert, make_pose, steps_between
from asfm.navigation.attitude_conflict import resolve_attitude_conflict
from asfm.navigation.fault_diagnostics import diagnose_odometry, diagnose_time_offset
from asfm.navigation.fault_hypotheses import Hypothesis
from asfm.navigation.frame_navigation import FrameNavigation
from asfm.navigation.odometry_check import (
    OdometryTest,
    compare_odometry_hypotheses,
    measure_disagreement,
)
from asfm.navigation.odometry_hypotheses import PointPairs, planar_inliers
from asfm.navigation.sensor_consistency import align_initial_attitude, estimate_time_offset
from asfm.navigation.sensor_constraints import (
    UNRELIABLE_SIGMA_FACTOR,
    SensorConstraints,
    level_pose,
    sensor_constraints,
)
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, Tracks

MIN_PRIOR_SIGMA = 1e-3
"""Smallest sigma of a step in the motion prior, in radians and in metres per metre of the sonar's range."""
UNKNOWN_PRIOR_SIGMA = 0.5
"""The same where no two frames share enough features: they may see different places."""


@dataclass(frozen=True)
class InitialPoses:
    """Initial poses, and the constraints between and on them."""

    world_from_vehicle: FloatArray
    """(N, 4, 4)"""
    sensors: SensorConstraints
    unreliable: BoolArray
    """(N - 1,) which steps of the initial poses should be replaced before the adjustment."""


def initialise_from_odometry(navigation: FrameNavigation, sequence: Sequence) -> InitialPoses | None:
    """Initialise the poses from odometry; None where there is none or it is not used.

    Args:
        navigation: odometry, depth and attitude at the frame times.
        sequence: states the noise of its sensors.
    """
    odometry = navigation.odometry
    if odometry is None:
        return None
    poses = odometry.world_from_vehicle
    sensors = sensor_constraints(sequence, navigation, poses, odometry.step_sigma, measured=True)
    return InitialPoses(poses, sensors, odometry.unreliable)


def verify_odometry(
    initial: InitialPoses, sequence: Sequence, point_pairs: list[PointPairs], config: Config, rng: np.random.Generator
) -> InitialPoses:
    """Test odometry against the images and navigation; correct it, or increase its sigmas, where they contradict it.

    Args:
        initial: poses and constraints from the odometry.
        sequence: gives the sonar, its lever arm and the stated noise.
        point_pairs: matched points of near frames.
        config: section ``noise``.
        rng: draws the RANSAC samples.
    """
    reliable = [pair for pair in point_pairs if not initial.unreliable[pair.frame_a : pair.frame_b].any()]
    inliers = planar_inliers(reliable, rng)
    poses, sensors = initial.world_from_vehicle, initial.sensors
    test = compare_odometry_hypotheses(poses, sensors, inliers, sequence, config, reliable)
    shift = estimate_time_offset(poses, sensors.depth_attitude, sequence.noise)
    contradicted = test is not None and test.contradicted
    if not inliers or not (contradicted or shift):
        return InitialPoses(*resolve_attitude_conflict(poses, sensors, inliers, sequence), initial.unreliable)
    likely = test.hypotheses.get(str(test.likely_fault)) if test is not None and contradicted else None
    if test is not None and likely is not None and likely.correctable:
        return _correct_fault(initial, test, likely, sequence)
    sigma = measure_disagreement(poses, inliers, sequence.vehicle_from_sonar)
    found = [diagnose_odometry(test, sigma)] if test is not None and contradicted else []
    if shift:
        found.append(diagnose_time_offset(shift * float(np.median(np.diff(sequence.timestamps_s))), sigma))
    sensors = replace(
        sensors, step_sigma=np.hypot(sensors.step_sigma, sigma), diagnostics=(*sensors.diagnostics, *found)
    )
    return InitialPoses(poses, sensors, np.ones(len(initial.unreliable), dtype=bool))


def _correct_fault(initial: InitialPoses, test: OdometryTest, likely: Hypothesis, sequence: Sequence) -> InitialPoses:
    """Undo the likely fault of odometry, depth and attitude, and increase the sigmas of the steps."""
    sensors, corrected = initial.sensors, likely.world_from_vehicle
    sensors = replace(sensors, z_roll_pitch=sensors.z_roll_pitch * np.asarray(likely.reading_signs))
    every_channel = np.ones(3, dtype=bool)
    corrected, _ = align_initial_attitude(corrected, sensors.depth_attitude, sequence.noise, every_channel)
    sigma = UNRELIABLE_SIGMA_FACTOR * sensors.step_sigma
    sensors = replace(
        sensors,
        first_pose=corrected[0],
        steps=steps_between(corrected),
        step_sigma=sigma,
        diagnostics=(*sensors.diagnostics, diagnose_odometry(test, np.median(sigma, axis=0))),
    )
    return InitialPoses(corrected, sensors, initial.unreliable)


def replace_unreliable_steps(
    initial: InitialPoses, sequence: Sequence, tracks: Tracks, rng: np.random.Generator
) -> InitialPoses:
    """Replace the unreliable steps of the initial poses by planar motions where the tracks support one.

    Args:
        initial: poses and constraints from the odometry.
        sequence: gives the lever arm and the stated noise.
        tracks: built without known poses.
        rng: draws the RANSAC samples.
    """
    poses = initial.world_from_vehicle
    planar, supported = planar_odometry(tracks, len(poses), poses[0], sequence.vehicle_from_sonar, rng)
    replaced = (initial.unreliable & supported[1:])[:, None, None]
    chain = chain_steps(poses[0], np.where(replaced, steps_between(planar), steps_between(poses)))
    chain = make_pose(chain[:, :3, 3], Rotation.from_matrix(chain[:, :3, :3]))
    depth_attitude = initial.sensors.depth_attitude
    trusted = np.full(3, bool(initial.unreliable.all()))
    chain, _ = align_initial_attitude(chain, depth_attitude, sequence.noise, trusted)
    return InitialPoses(chain, replace(initial.sensors, first_pose=chain[0]), initial.unreliable)


def initialise_from_tracks(
    navigation: FrameNavigation, sequence: Sequence, tracks: Tracks, config: Config, rng: np.random.Generator
) -> InitialPoses:
    """Initialise the poses from the planar odometry of tracks, with a motion prior as constraints.

    The planar odometry is no measurement, as it is made from the same tracks. Where the tracks do not constrain the
    poses, the motion prior does: each step is zero, with sigmas of a few typical steps of the planar odometry.

    Args:
        navigation: depth and attitude at the frame times.
        sequence: gives the sonar and its lever arm.
        tracks: built without known poses.
        config: section ``backend``.
        rng: draws the RANSAC samples.
    """
    readings = navigation.depth_attitude.z_roll_pitch
    first_pose = level_pose(readings[0]) if len(readings) else np.eye(4)
    poses, supported = planar_odometry(tracks, len(sequence), first_pose, sequence.vehicle_from_sonar, rng)
    feature_sigma = observation_sigma(tracks, sequence.sonar, config.noise)
    still = (
        np.zeros(len(poses) - 1, dtype=bool) if len(readings) else find_standstill(tracks, len(poses), feature_sigma)
    )
    max_range_m = float(sequence.sonar.range_edges_m[-1])
    typical = typical_steps(poses, supported[1:] & ~still)
    known = supported[1:].any() or still.any()
    smallest = MIN_PRIOR_SIGMA if known else UNKNOWN_PRIOR_SIGMA
    typical = np.maximum(typical, [smallest, smallest * max_range_m])
    stationary = np.repeat(poses[:1], len(poses), axis=0)
    step_sigma = config.backend.motion_prior_factor * typical
    sensors = sensor_constraints(sequence, navigation, stationary, step_sigma, measured=False)
    initial = InitialPoses(poses, sensors, np.zeros(len(step_sigma), dtype=bool))
    return _hold_standstill(initial, still, feature_sigma) if still.any() else initial


def _hold_standstill(initial: InitialPoses, still: BoolArray, feature_sigma: FloatArray) -> InitialPoses:
    """Hold the poses during the (N - 1,) steps in which no motion is seen.

    Args:
        initial: of the planar odometry and a motion prior.
        still: of :func:`find_standstill`.
        feature_sigma: (O, 2) standard deviations of the observations' range in m and bearing in rad.
    """
    poses, sensors = initial.world_from_vehicle, initial.sensors
    chain = chain_steps(poses[0], np.where(still[:, None, None], np.eye(4), steps_between(poses)))
    chain = make_pose(chain[:, :3, 3], Rotation.from_matrix(chain[:, :3, :3]))
    held = np.where(still[:, None], np.minimum(sensors.step_sigma, standstill_sigma(feature_sigma)), sensors.step_sigma)
    found = (diagnose_standstill(feature_sigma),) if still.all() else ()
    diagnostics = (*sensors.diagnostics, *found)
    sensors = replace(sensors, step_sigma=held, standstill=still, diagnostics=diagnostics)
    return replace(initial, world_from_vehicle=chain, sensors=sensors)


def search_from_tracks(
    initial: InitialPoses, sequence: Sequence, tracks: Tracks, config: Config, rng: np.random.Generator
) -> InitialPoses:
    """Search the poses in six degrees of freedom, from those of the planar odometry.

    With odometry, depth or attitude the initial poses are returned as they are: roll, pitch and height are measured.

    Args:
        initial: of :func:`initialise_from_tracks`.
        sequence: gives the sonar and its lever arm.
        tracks: built without known poses.
        config: sections ``noise`` and ``backend``.
        rng: draws the elevations at which points begin.
    """
    sensors, lever_arm = initial.sensors, sequence.vehicle_from_sonar
    if sensors.measured or len(sensors.z_roll_pitch) or not len(sensors.steps):
        return initial
    if sensors.standstill is not None and sensors.standstill.all():
        return initial
    typical_step = sensors.step_sigma.max(axis=0) / config.backend.motion_prior_factor
    planar = initial.world_from_vehicle @ lever_arm
    # Threads cost more than they save in matrices of this size.
    with threadpool_limits(1):
        found = search_poses(tracks, planar, typical_step, sequence.sonar, config.noise, rng)
    return replace(initial, world_from_vehicle=found @ invert(lever_arm))
