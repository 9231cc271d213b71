"""The motion prior of a sonar without odometry, loosened once the poses are about right."""

from dataclasses import replace

import gtsam
import numpy as np
from scipy.spatial.transform import Rotation

from asfm.backend.estimation.solution import Solution, solve_tracks
from asfm.backend.graph.factors import step_factor
from asfm.backend.graph.problem import FIRST_POSE
from asfm.config import Config
from asfm.geometry.poses import invert
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.sequence import Sequence
from asfm.types import FloatArray

SPAN = 10
"""Frames over which the motion is looked at."""


def widen_motion_prior(solution: Solution, sequence: Sequence, config: Config) -> Solution:
    """Adjust once more with a motion prior that the turns found so far do not strain.

    The prior that the vehicle moves little must be tight as long as poses are far from the truth: else they settle
    where they should not. At the end it does harm: it counts the steps as independent, but vehicles turn on for many
    frames, and what is slow (roll, pitch) is drawn towards zero by many sigmas of what is then stated.

    Solutions with odometry are left as they are: their steps are measurements.
    """
    sensors = solution.problem.sensors
    if sensors.measured or not len(sensors.steps) or not solution.observed.any():
        return solution
    poses = solution.bundle.world_from_vehicle
    return solve_tracks(solution.tracks, sequence, poses, loosen_turns(sensors, poses), config)


def loosen_turns(sensors: SensorConstraints, world_from_vehicle: FloatArray) -> SensorConstraints:
    """Widen the guessed steps' rotations until independent steps add up to what the turns add up to over a span.

    The sigma of a step is the root mean square of the turn over n frames, over the root of n. For independent steps
    that is their own root mean square; for steady turns it is larger by the root of n. Translations are left as they
    are: their prior comes from planar motions, which show the largest of them, but no rolls and pitches.

    Args:
        world_from_vehicle: (N, 4, 4), N > 1.
    """
    typical_rad, _ = measure_motion(world_from_vehicle).tolist()
    return replace(sensors, step_sigma=np.maximum(sensors.step_sigma, [typical_rad, 0.0]))


def measure_motion(world_from_vehicle: FloatArray) -> FloatArray:
    """Root mean square (2,) of rotation and translation over a span, each axis, as independent steps: over its root."""
    count = min(SPAN, len(world_from_vehicle) - 1)
    motion = invert(world_from_vehicle[:-count]) @ world_from_vehicle[count:]
    rotation_rad = Rotation.from_matrix(motion[:, :3, :3]).as_rotvec()
    return np.sqrt([np.mean(rotation_rad**2) / count, np.mean(motion[:, :3, 3] ** 2) / count])


def state_prior_covariance(solution: Solution, factor: float) -> Solution:
    """State what is known with a motion prior that the whole motion does not strain; poses and points stay.

    A prior tighter than the motion is steadies an estimate, but it is no knowledge: the covariances of the estimate
    are those of the data and of a prior as wide as the motion over spans, turns and translations alike, times a factor.

    Args:
        factor: ``backend.motion_prior_factor``.
    """
    sensors, bundle = solution.problem.sensors, solution.bundle
    if sensors.measured or not len(sensors.steps):
        return solution
    typical = factor * measure_motion(bundle.world_from_vehicle)
    wide = replace(sensors, step_sigma=np.maximum(sensors.step_sigma, typical))
    return replace(
        solution,
        problem=replace(solution.problem, sensors=wide),
        bundle=replace(
            bundle, graph=_replace_steps(bundle.graph, wide), measured=_replace_steps(bundle.measured, wide)
        ),
    )


def _replace_steps(graph: gtsam.NonlinearFactorGraph, sensors: SensorConstraints) -> gtsam.NonlinearFactorGraph:
    """Give a copy of a graph with the sigmas of other sensors' steps."""
    changed = graph.clone()
    for index in range(changed.size()):
        factor = changed.at(index)
        if isinstance(factor, gtsam.BetweenFactorPose3):
            first, second = factor.keys()
            step = int(first - FIRST_POSE)
            changed.replace(index, step_factor(first, second, sensors.steps[step], *sensors.step_sigma[step].tolist()))
    return changed
