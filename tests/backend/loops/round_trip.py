"""A made-up round trip for tests of loops: odometry and tracks, optimised, and what the way back sees again."""

from dataclasses import dataclass
from functools import lru_cache

import gtsam
import numpy as np
from scipy.spatial.transform import Rotation

from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.bundle_adjustment import Bundle
from asfm.backend.graph.factors import bearing_factor, range_factor, step_factor
from asfm.backend.graph.problem import FIRST_POINT, FIRST_POSE, BundleProblem
from asfm.geometry.poses import chain_steps, invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, project
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.sequence import Sequence
from asfm.types import FloatArray, SensorNoise, Tracks
from tests.worlds import no_frame, number_keypoints

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.6, 0.6), (600, 256), np.deg2rad(20))
SIGMA = np.array([0.02, 0.005])
STEP_SIGMA = (0.01, 0.04)
WINDOW = 8


@dataclass(frozen=True)
class RoundTrip:
    """Out and back along a wall, with short tracks and drifting odometry."""

    truth: FloatArray
    solution: Solution
    sequence: Sequence
    again: Tracks
    """Observations, by the last frames of the way back, of the landmarks of the way out."""


@lru_cache(maxsize=4)
def make_round_trip(seed: int, count: int = 30) -> RoundTrip:
    """Make a round trip, solved from odometry and tracks without its loop."""
    rng = np.random.default_rng(seed)
    place_m = 6 * np.sin(np.linspace(0, np.pi, count))
    swing = 0.05 * rng.standard_normal((count, 6))
    swing[:, 1] += place_m
    truth = make_pose(swing[:, :3], Rotation.from_euler("ZYX", swing[:, 3:]))
    slip = rng.normal(0, np.repeat(STEP_SIGMA, 3), (count - 1, 6))
    steps = invert(truth[:-1]) @ truth[1:] @ make_pose(slip[:, 3:], Rotation.from_rotvec(slip[:, :3]))
    initial = chain_steps(truth[0], steps)
    xyz_m = rng.uniform([3, -4, -0.4], [8, 10, 0.4], (110, 3))
    seen = transform(invert(truth)[:, None], xyz_m)
    frame, point = np.nonzero(SONAR.sees(seen))
    half = np.where(frame < count // 2, 0, 1)  # the way back begins tracks of its own
    key, track = np.unique(2 * point + half, return_inverse=True)
    order = np.lexsort((frame, track))
    frame, point, track = frame[order], point[order], track[order]
    range_m, bearing_rad, _ = project(seen[frame, point])
    noise = rng.normal(0, SIGMA, (len(frame), 2))
    tracks = number_keypoints(Tracks(track, frame, range_m + noise[:, 0], bearing_rad + noise[:, 1]))
    bundle = _adjust(tracks, initial, steps, xyz_m[key // 2])
    partner = np.searchsorted(key, 2 * point)  # the way out's track of the same point
    back = (frame >= count - 5) & np.isin(2 * point, key)
    again = Tracks(partner[back], frame[back], tracks.range_m[back], tracks.bearing_rad[back])
    stated = SensorNoise(odometry_rotation_rad=STEP_SIGMA[0], odometry_translation_m=STEP_SIGMA[1])
    sequence = Sequence("round trip", SONAR, np.arange(count, dtype=float), no_frame, noise=stated)
    return RoundTrip(
        truth,
        Solution(tracks, np.ones(len(track), dtype=bool), bundle, _pose_problem(tracks, steps), np.ones(tracks.count)),
        sequence,
        again,
    )


def _pose_problem(tracks: Tracks, steps: FloatArray) -> BundleProblem:
    """Make the problem that the round trip was optimised from: steps measured by odometry."""
    nothing = np.zeros((0, 3))
    step_sigma = np.tile(STEP_SIGMA, (len(steps), 1))
    sensors = SensorConstraints(np.eye(4), np.ones(6), True, steps, step_sigma, nothing, nothing)
    used, sigma = np.ones(len(tracks), dtype=bool), np.tile(SIGMA, (len(tracks), 1))
    return BundleProblem(tracks, used, sigma, sensors, np.eye(4), SONAR.elevation_aperture_rad / 2)


def _adjust(tracks: Tracks, initial: FloatArray, steps: FloatArray, xyz_m: FloatArray) -> Bundle:
    graph, values, lever_arm = gtsam.NonlinearFactorGraph(), gtsam.Values(), gtsam.Pose3()
    graph.add(gtsam.PriorFactorPose3(FIRST_POSE, gtsam.Pose3(initial[0]), gtsam.noiseModel.Isotropic.Sigma(6, 1e-4)))
    for index, step in enumerate(steps):
        graph.add(step_factor(FIRST_POSE + index, FIRST_POSE + index + 1, step, *STEP_SIGMA))
    for index, pose in enumerate(initial):
        values.insert(FIRST_POSE + index, gtsam.Pose3(pose))
    for index, point in enumerate(xyz_m):
        values.insert(FIRST_POINT + index, point)
        prior = gtsam.noiseModel.Isotropic.Sigma(3, 2.0)
        graph.add(gtsam.PriorFactorPoint3(FIRST_POINT + index, point + 0.1, prior))
    for track, frame, range_m, bearing_rad in zip(
        tracks.track.tolist(), tracks.frame.tolist(), tracks.range_m.tolist(), tracks.bearing_rad.tolist(), strict=True
    ):
        keys = FIRST_POSE + frame, FIRST_POINT + track
        graph.add(range_factor(*keys, range_m, SIGMA[0], lever_arm))
        graph.add(bearing_factor(*keys, bearing_rad, SIGMA[1], lever_arm))
    values = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    poses = np.stack([values.atPose3(FIRST_POSE + index).matrix() for index in range(len(initial))])
    points = np.stack([values.atPoint3(FIRST_POINT + index) for index in range(len(xyz_m))])
    return Bundle(poses, points, np.ones(len(xyz_m), dtype=bool), graph, graph, values)
