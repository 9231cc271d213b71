"""Motion prior of a sonar without odometry: widened after convergence, and covariances stated with the wider prior."""

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
from asfm.types import BoolArray, FloatArray

SPAN_FRAMES = 10
"""Frames over which the size of the motion is estimated."""


def widen_motion_prior(solution: Solution, sequence: Sequence, config: Config) -> Solution:
    """Adjust once more with a motion prior as wide as the estimated rotations.

    The prior that the vehicle moves little must be tight while poses are far from the truth, or they converge to a
    wrong optimum. After convergence it biases the result: it treats steps as independent, but vehicles rotate on for
    many frames, and slow roll and pitch are pulled towards zero by many stated sigmas. A solution with odometry is
    returned unchanged: its steps are measurements.

    Args:
        solution: converged, with the tight prior.
        sequence: as for :func:`solve_tracks`.
        config: as for :func:`solve_tracks`.
    """
    sensors = solution.problem.sensors
    if sensors.measured or not len(sensors.steps) or not solution.observed.any():
        return solution
    poses = solution.bundle.world_from_vehicle
    return solve_tracks(solution.tracks, sequence, poses, widen_rotation_sigma(sensors, poses), config)


def widen_rotation_sigma(sensors: SensorConstraints, world_from_vehicle: FloatArray) -> SensorConstraints:
    """Widen the rotation sigmas of the prior's steps to the size of the estimated rotations.

    Translation sigmas are kept: they come from planar motion estimates, which include translations but no roll or
    pitch.

    Args:
        sensors: steps of the motion prior.
        world_from_vehicle: (N, 4, 4) poses, N > 1.
    """
    rotation_rad, _ = estimate_step_sigma(world_from_vehicle, sensors.standstill).tolist()
    return _widen_moving(sensors, np.array([rotation_rad, 0.0]))


def _widen_moving(sensors: SensorConstraints, sigma: FloatArray) -> SensorConstraints:
    """Widen the sigmas of the steps to (2,) given ones at least, but not those of a standstill."""
    wide = np.maximum(sensors.step_sigma, sigma)
    if sensors.standstill is not None:
        wide[sensors.standstill] = sensors.step_sigma[sensors.standstill]
    return replace(sensors, step_sigma=wide)


def estimate_step_sigma(world_from_vehicle: FloatArray, standstill: BoolArray | None = None) -> FloatArray:
    """Estimate the sigma of independent steps that add up to the motion over spans of n frames.

    It is the root mean square of the motion over a span, divided by sqrt(n). For independent steps that is their own
    root mean square; for a steady motion it is larger by sqrt(n).

    Args:
        world_from_vehicle: (N, 4, 4) poses, N > 1.
        standstill: (N - 1,) steps that are left out where others remain, with the spans that touch them.

    Returns:
        (2,) rotation in rad and translation in m, each axis.
    """
    count = min(SPAN_FRAMES, len(world_from_vehicle) - 1)
    motion = invert(world_from_vehicle[:-count]) @ world_from_vehicle[count:]
    if standstill is not None:
        stood = np.concatenate([[0], np.cumsum(standstill)])
        moving = stood[count:] == stood[:-count]
        motion = motion[moving] if moving.any() else motion
    rotation_rad = Rotation.from_matrix(motion[:, :3, :3]).as_rotvec()
    return np.sqrt([np.mean(rotation_rad**2) / count, np.mean(motion[:, :3, 3] ** 2) / count])


def state_prior_covariance(solution: Solution, factor: float) -> Solution:
    """Replace the motion prior in the graph of a solution by one as wide as the motion, for covariances.

    A prior that is tighter than the motion regularises the estimate but is no information. Poses and points are kept;
    covariances then follow from the measurements and the wide prior, in rotation and translation.

    Args:
        solution: with or without odometry; with it, it is returned unchanged.
        factor: ``backend.motion_prior_factor``, sigma of the prior relative to the motion.
    """
    sensors, bundle = solution.problem.sensors, solution.bundle
    if sensors.measured or not len(sensors.steps):
        return solution
    wide = _widen_moving(sensors, factor * estimate_step_sigma(bundle.world_from_vehicle, sensors.standstill))
    return replace(
        solution,
        problem=replace(solution.problem, sensors=wide),
        bundle=replace(
            bundle, graph=_replace_steps(bundle.graph, wide), measured=_replace_steps(bundle.measured, wide)
        ),
    )


def _replace_steps(graph: gtsam.NonlinearFactorGraph, sensors: SensorConstraints) -> gtsam.NonlinearFactorGraph:
    """Return a copy of a graph with the step factors of other sensor constraints."""
    changed = graph.clone()
    for index in range(changed.size()):
        factor = changed.at(index)
        if isinstance(factor, gtsam.BetweenFactorPose3):
            first, second = factor.keys()
            step = int(first - FIRST_POSE)
            changed.replace(index, step_factor(first, second, sensors.steps[step], *sensors.step_sigma[step].tolist()))
    return changed
