"""The motion prior of a sonar without odometry, loosened once the poses are about right."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.backend.sensors import SensorConstraints
from asfm.backend.solution import Solution, solve_tracks
from asfm.config import Config
from asfm.poses import invert
from asfm.sequence import Sequence
from asfm.types import FloatArray

SPAN = 10
"""Frames over which the motion is looked at."""


def relax_motion(solution: Solution, sequence: Sequence, config: Config) -> Solution:
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
    count = min(SPAN, len(world_from_vehicle) - 1)
    turn = invert(world_from_vehicle[:-count]) @ world_from_vehicle[count:]
    rotation_rad = Rotation.from_matrix(turn[:, :3, :3]).as_rotvec()
    typical_rad = float(np.sqrt(np.mean(rotation_rad**2) / count))
    return replace(sensors, step_sigma=np.maximum(sensors.step_sigma, [typical_rad, 0.0]))
