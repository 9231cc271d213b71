"""Conflicts between odometry and depth or attitude, resolved with the images."""

from collections.abc import Sequence as Rows
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.diagnostics import Diagnostic
from asfm.geometry.poses import depth_roll_pitch, heading, make_pose, steps_between
from asfm.navigation.odometry_check import MIN_FRAME_PAIRS
from asfm.navigation.odometry_hypotheses import PointPairs, median_arc_distance_m
from asfm.navigation.sensor_consistency import compare_odometry_attitude, describe_conflicts
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.sequence import Sequence
from asfm.types import FloatArray, SensorNoise

BETTER_FIT_RATIO = 0.9
"""The images agree with navigation when its height, roll and pitch reduce the arc distance below this share."""


def resolve_attitude_conflict(
    world_from_vehicle: FloatArray,
    sensors: SensorConstraints,
    pairs: Rows[PointPairs],
    sequence: Sequence,
) -> tuple[FloatArray, SensorConstraints]:
    """Resolve conflicts between odometry and depth or attitude with the images.

    Where the images agree with navigation, odometry takes its values in the channels concerned. Otherwise navigation is
    left out there, because odometry alone is free of contradictions.

    Args:
        world_from_vehicle: (N, 4, 4) odometry.
        sensors: constraints from the odometry, depth and attitude.
        pairs: planar-motion inliers of frame pairs.
        sequence: gives the sonar, its lever arm and the stated noise.

    Returns:
        (N, 4, 4) initial poses, and the constraints on them.
    """
    consistency = compare_odometry_attitude(world_from_vehicle, sensors.depth_attitude, sequence.noise)
    conflict = consistency.contradicts
    if not conflict.any():
        return world_from_vehicle, sensors
    readings = np.where(conflict, sensors.z_roll_pitch, depth_roll_pitch(world_from_vehicle))
    corrected = _with_depth_attitude(world_from_vehicle, readings)
    sentences, remedy = describe_conflicts(consistency), _image_support(world_from_vehicle, corrected, pairs, sequence)
    if remedy:
        found = tuple(Diagnostic("sensor-conflict", f"{sentence}; {remedy}") for sentence in sentences)
        return corrected, recompute_steps(sensors, corrected, sequence.noise, found)
    sigma = sensors.z_roll_pitch_sigma.copy()
    sigma[:, conflict] = np.inf
    found = tuple(Diagnostic("sensor-conflict", f"{sentence}; navigation's is left out") for sentence in sentences)
    return world_from_vehicle, replace(sensors, z_roll_pitch_sigma=sigma, diagnostics=(*sensors.diagnostics, *found))


def _image_support(
    recorded: FloatArray, corrected: FloatArray, pairs: Rows[PointPairs], sequence: Sequence
) -> str | None:
    """Describe how much better the images agree with corrected poses, (N, 4, 4); None where they do not clearly."""
    if len(pairs) < MIN_FRAME_PAIRS:
        return None
    lever, sonar = sequence.vehicle_from_sonar, sequence.sonar
    recorded_m, corrected_m = (
        float(np.mean([median_arc_distance_m(pair, poses @ lever, sonar) for pair in pairs]))
        for poses in (recorded, corrected)
    )
    if corrected_m < BETTER_FIT_RATIO * recorded_m:
        distances = f"{corrected_m:.2g} m instead of {recorded_m:.2g} m"
        return f"the images agree with navigation ({distances}): odometry takes its values"
    return None


def recompute_steps(
    sensors: SensorConstraints,
    world_from_vehicle: FloatArray,
    noise: SensorNoise,
    diagnostics: tuple[Diagnostic, ...],
) -> SensorConstraints:
    """Replace the steps by those between corrected poses, with the noise that depth and attitude add to them.

    Args:
        sensors: constraints before the correction.
        world_from_vehicle: (N, 4, 4) corrected poses.
        noise: stated noise of depth and attitude.
        diagnostics: appended to those of the constraints.
    """
    angle_rad = max(noise.navigation_roll_rad, noise.navigation_pitch_rad)
    added = np.sqrt(2.0) * np.array([angle_rad, noise.navigation_z_m])
    return replace(
        sensors,
        first_pose=world_from_vehicle[0],
        steps=steps_between(world_from_vehicle),
        step_sigma=np.hypot(sensors.step_sigma, added),
        diagnostics=(*sensors.diagnostics, *diagnostics),
    )


def _with_depth_attitude(world_from_vehicle: FloatArray, z_roll_pitch: FloatArray) -> FloatArray:
    """Replace the height, roll and pitch of (N, 4, 4) poses by (N, 3) readings; keep x, y and heading."""
    angles = np.stack([heading(world_from_vehicle), z_roll_pitch[:, 2], z_roll_pitch[:, 1]], axis=1)
    position = np.concatenate([world_from_vehicle[:, :2, 3], z_roll_pitch[:, :1]], axis=1)
    return make_pose(position, Rotation.from_euler("ZYX", angles))
