"""Builders that many tests share: sequences without images, their sensor constraints, keypoints and frame pairs."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from asfm.config import BackendConfig
from asfm.frontend.matching.frame_pair import FramePair
from asfm.frontend.matching.nearest import NearestNeighbours
from asfm.geometry.elevation_arcs import project_arcs
from asfm.geometry.poses import make_pose, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.sensor_constraints import SensorConstraints, sensor_constraints
from asfm.sequence import Sequence
from asfm.types import Descriptors, FloatArray, Frame, Keypoints, Tracks

BACKEND = BackendConfig()


def no_frame(index: int) -> Frame:
    """Stand in for the reader of a sequence whose images must not be read."""
    raise AssertionError(f"frame {index} must not be read")


def make_constraints(
    sequence: Sequence, poses: FloatArray, step_sigma: FloatArray, measured: bool, config: BackendConfig = BACKEND
) -> SensorConstraints:
    """Make the constraints of a sequence's sensors on (N, 4, 4) poses with (N - 1, 2) sigmas of their steps."""
    return sensor_constraints(sequence, read_navigation(sequence, config), poses, step_sigma, measured)


def number_keypoints(tracks: Tracks) -> Tracks:
    """Let tracks know their keypoints: each frame's are its observations, in the order of the tracks."""
    keypoint = np.empty(len(tracks), dtype=np.int64)
    for observations in tracks.by_frame(int(tracks.frame.max(initial=-1)) + 1):
        keypoint[observations] = np.arange(len(observations))
    return replace(tracks, keypoint=keypoint)


def make_keypoints(
    range_m: FloatArray,
    bearing_rad: FloatArray,
    descriptors: Descriptors | None = None,
    patches: NDArray[np.floating] | None = None,
    sonar: SonarModel | None = None,
) -> Keypoints:
    """Make keypoints at (K,) ranges and bearings; zeros for what is not given, positions in the image from a sonar."""
    count = len(range_m)
    row_column = np.zeros((count, 2))
    if sonar is not None:
        row_column = np.stack([sonar.row_at_range(range_m), sonar.column_at_bearing(bearing_rad)], axis=1)
    return Keypoints(
        row_column,
        range_m,
        bearing_rad,
        np.ones(count),
        np.zeros((count, 61), dtype=np.uint8) if descriptors is None else descriptors,
        np.zeros((count, 3, 3), dtype=np.float32) if patches is None else patches.astype(np.float32),
    )


def observe_points(
    xyz_m: FloatArray,
    descriptors: Descriptors | None = None,
    patches: NDArray[np.floating] | None = None,
    sonar: SonarModel | None = None,
) -> Keypoints:
    """Make the keypoints of (K, 3) points in the sonar frame, without noise."""
    range_m, bearing_rad, _ = project(xyz_m)
    return make_keypoints(range_m, bearing_rad, descriptors, patches, sonar)


def range_bearing(xyz_m: FloatArray) -> FloatArray:
    """Project (..., 3) points in the sonar frame to (..., 2) range_m and bearing_rad."""
    range_m, bearing_rad, _ = project(xyz_m)
    return np.stack([range_m, bearing_rad], axis=-1)


def random_points(
    rng: np.random.Generator, count: int, range_m: tuple[float, float], bearing_rad: float, elevation_rad: float
) -> FloatArray:
    """Draw (count, 3) points in the sonar frame, uniform in range, in +-bearing_rad and in +-elevation_rad."""
    ranges_m, bearings_rad = rng.uniform(*range_m, count), rng.uniform(-bearing_rad, bearing_rad, count)
    return back_project(ranges_m, bearings_rad, rng.uniform(-elevation_rad, elevation_rad, count))


MATCHING_SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (600, 256), 0.3)
B_FROM_A = make_pose(np.array([0.2, -0.3, 0.05]), Rotation.from_rotvec([0.02, -0.01, 0.1]))


def make_frame_pair(seed: int = 0, count: int = 60, wrong: int = 12) -> FramePair:
    """Make a frame pair of one scene, related by B_FROM_A, whose first matches are wrong: other points and patches."""
    rng = np.random.default_rng(seed)
    points = random_points(rng, count, (2, 8), 0.6, 0.1)
    moved = transform(B_FROM_A, points)
    moved[:wrong] = random_points(rng, wrong, (2, 8), 0.6, 0.1)
    patches = rng.random((count, 15, 15))
    other = patches + 0.02 * rng.random(patches.shape)
    other[:wrong] = rng.random((wrong, 15, 15))
    ratio = np.where(np.arange(count) < wrong, 0.95, 0.6)
    nearest = NearestNeighbours(np.stack([np.arange(count)] * 2, axis=1), ratio, np.arange(count) >= wrong)
    a, b = observe_points(points, patches=patches), observe_points(moved, patches=other)
    arcs = project_arcs(MATCHING_SONAR, B_FROM_A, a.range_bearing)
    return FramePair(a, b, nearest, MATCHING_SONAR, arcs, np.tile([0.02, 0.01], (count, 1)))
