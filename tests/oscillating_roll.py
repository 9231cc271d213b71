"""A sonar whose roll oscillates and rests around the middle frame, where an optimisation may take the mirror image."""

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, project
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.sequence import Sequence
from asfm.types import FloatArray, Tracks
from tests.worlds import make_constraints, no_frame

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (1500, 256), np.deg2rad(20))
LEVER_ARM = make_pose(np.array([0.2, -0.1, -0.1]), Rotation.from_euler("ZYX", [0.1, 0.05, 0.0]))
FRAMES, FLIP = 41, 20


def make_motion() -> FloatArray:
    """Make (N, 4, 4) poses from the identity on, with an oscillating roll that rests around the middle."""
    along = np.arange(FRAMES) - FLIP
    roll = 0.35 * np.sin(along / 7) ** 3
    yaw = 0.2 * np.sin(along / 9)
    position = np.stack([0.2 * np.sin(along / 8), 0.1 * along, 0.05 * np.sin(along / 6)], axis=1)
    poses = make_pose(position, Rotation.from_euler("ZYX", np.stack([yaw, 0 * yaw, roll], axis=1)))
    return np.asarray(invert(poses[0]) @ poses)


def make_tracks(poses: FloatArray) -> Tracks:
    """Make tracks of up to fifteen frames each, with little noise."""
    rng = np.random.default_rng(7)
    middle = rng.integers(0, FRAMES, 500)
    in_sonar = rng.uniform([3.0, -1.5, -0.5], [6.0, 1.5, 0.5], (500, 3))
    points = transform((poses @ LEVER_ARM)[middle], in_sonar)
    seen = transform(invert(poses @ LEVER_ARM), points[:, None])
    near = np.abs(np.arange(FRAMES) - middle[:, None]) <= 7
    long = (SONAR.sees(seen) & near).sum(axis=1) >= 5
    track, frame = np.nonzero(SONAR.sees(seen)[long] & near[long])
    range_m, bearing_rad, _ = project(seen[long][track, frame])
    sigma = np.tile([0.01, 0.003], (len(track), 1))
    error = rng.normal(0, 0.3, (len(track), 2)) * sigma
    return Tracks(track, frame, range_m + error[:, 0], bearing_rad + error[:, 1], sigma=sigma)


def make_case(measured: bool = False) -> tuple[Tracks, Sequence, SensorConstraints, FloatArray]:
    truth = make_motion()
    sequence = Sequence("made up", SONAR, np.arange(FRAMES, dtype=float), no_frame, LEVER_ARM)
    held = truth if measured else np.repeat(np.eye(4)[None], FRAMES, axis=0)
    sensors = make_constraints(sequence, held, np.tile([0.08, 0.15], (FRAMES - 1, 1)), measured)
    return make_tracks(truth), sequence, sensors, truth


def roll_rad(world_from_vehicle: FloatArray) -> FloatArray:
    return np.asarray(Rotation.from_matrix(world_from_vehicle[:, :3, :3]).as_euler("ZYX")[:, 2])
