"""Builders that many tests share: sequences without images, their sensor constraints, keypoints and frame pairs."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from asfm.config import BackendConfig
from asfm.frontend.matching.frame_pair import FramePair
from asfm.frontend.matching.nearest import NearestNeighbours
from asfm.geometry.elevation_arcs import project_arcs
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.odometry_hypotheses import PointPairs
from asfm.navigation.sensor_constraints import SensorConstraints, sensor_constraints
from asfm.sequence import Sequence
from asfm.simulation.vehicle.sensors import simulate_navigation, simulate_odometry
from asfm.types import (
    Descriptors,
    FloatArray,
    Frame,
    Keypoints,
    Landmarks,
    Navigation,
    SensorNoise,
    Tracks,
    Trajectory,
)

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


NO_TRACKS = Tracks(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
VEHICLE_FRAMES = 40
VEHICLE_SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.6, 0.6), (700, 256), np.deg2rad(16))
VEHICLE_LEVER_ARM = make_pose(np.array([0.4, 0.1, -0.2]), Rotation.from_euler("ZYX", [0.0, 0.3, 0.0]))
VEHICLE_NOISE = SensorNoise(0.02, 0.005, 0.01, 0.003, 0.003)


def make_vehicle_path() -> FloatArray:
    """Make (N, 4, 4) poses of a vehicle that weaves over the floor, turns, rolls and heaves: every axis moves."""
    t = np.linspace(0, 4 * np.pi, VEHICLE_FRAMES)
    position = np.stack([0.08 * np.arange(VEHICLE_FRAMES), 0.5 * np.sin(t / 2), 2.0 + 0.25 * np.sin(0.8 * t)], axis=1)
    angles = np.stack([0.3 * np.sin(t / 2 + 1), 0.1 * np.sin(t), 0.2 * np.cos(0.7 * t)], axis=1)
    return make_pose(position, Rotation.from_euler("ZYX", angles))


def make_vehicle_sequence(seed: int = 0, noise: SensorNoise = VEHICLE_NOISE) -> Sequence:
    """Simulate odometry, depth and attitude of that path; the sequence states VEHICLE_NOISE whatever the noise is."""
    rng = np.random.default_rng(seed)
    truth = Trajectory(np.asarray(0.2 * np.arange(VEHICLE_FRAMES), dtype=np.float64), make_vehicle_path())
    return Sequence(
        "simulated",
        VEHICLE_SONAR,
        truth.timestamps_s,
        no_frame,
        VEHICLE_LEVER_ARM,
        odometry=simulate_odometry(truth, noise, rng),
        navigation=simulate_navigation(truth, noise, rng),
        groundtruth=truth,
        noise=VEHICLE_NOISE,
    )


def observe_floor(seed: int = 0) -> Tracks:
    """Observe points of an uneven floor from the vehicle's path, with the noise of features."""
    rng = np.random.default_rng(100 + seed)
    xyz_m = rng.uniform([0, -6, -0.3], [14, 6, 0.3], (800, 3))
    seen = transform(invert(make_vehicle_path() @ VEHICLE_LEVER_ARM), xyz_m[:, None])
    track, frame = np.nonzero(VEHICLE_SONAR.sees(seen))
    range_m, bearing_rad, _ = project(seen[track, frame])
    track = np.unique(track, return_inverse=True)[1].astype(np.int64)
    error = rng.normal(0, [0.015, 0.005], (len(track), 2))
    return Tracks(track, frame.astype(np.int64), range_m + error[:, 0], bearing_rad + error[:, 1])


def pair_points(tracks: Tracks) -> list[PointPairs]:
    """Pair the observations that frames of the vehicle's path 1, 2 and 4 apart have in common."""
    range_bearing = np.stack([tracks.range_m, tracks.bearing_rad], axis=1)
    pairs = []
    for gap in (1, 2, 4):
        for b in range(gap, VEHICLE_FRAMES):
            in_a, in_b = (np.flatnonzero(tracks.frame == index) for index in (b - gap, b))
            _, of_a, of_b = np.intersect1d(tracks.track[in_a], tracks.track[in_b], return_indices=True)
            pairs.append(PointPairs(b - gap, b, range_bearing[in_a[of_a]], range_bearing[in_b[of_b]], np.eye(4)))
    return pairs


INTERPOLATED_NOISE = SensorNoise(0.03, 0.004, 0.05, 0.006, 0.008)


def make_interpolated_sequence(frame_count: int = 5) -> Sequence:
    """Make frames at 0.5, 1.5 ... s, with odometry and navigation at 0, 1, 2 ... s, and INTERPOLATED_NOISE."""
    rng = np.random.default_rng(0)
    stamps = np.arange(frame_count + 1.0)
    poses = make_pose(rng.normal(0, 1, (len(stamps), 3)), Rotation.random(len(stamps), rng))
    navigation = Navigation(stamps, stamps * 0.1 - 2, 0.02 * stamps, -0.03 * stamps)
    return Sequence(
        "interpolated",
        VEHICLE_SONAR,
        0.5 + np.arange(frame_count, dtype=np.float64),
        no_frame,
        odometry=Trajectory(stamps, poses),
        navigation=navigation,
        noise=INTERPOLATED_NOISE,
    )


def mirror_axis(axis: int) -> Callable[[FloatArray], FloatArray]:
    """Make the fault of odometry that mirrors one axis of its positions."""
    sign = np.where(np.arange(3) == axis, -1.0, 1.0)
    return lambda poses: make_pose(poses[:, :3, 3] * sign, Rotation.from_matrix(poses[:, :3, :3]))


def mirror_angle(axis: int) -> Callable[[FloatArray], FloatArray]:
    """Make the fault of odometry that mirrors heading (0), pitch (1) or roll (2)."""
    sign = np.where(np.arange(3) == axis, -1.0, 1.0)

    def mirror(poses: FloatArray) -> FloatArray:
        angles = Rotation.from_matrix(poses[:, :3, :3]).as_euler("ZYX") * sign
        return make_pose(poses[:, :3, 3], Rotation.from_euler("ZYX", angles))

    return mirror


def make_landmarks(count: int, good: int) -> Landmarks:
    """Return landmarks at the origin of which the first ones are well constrained."""
    track = np.arange(count)
    return Landmarks(
        track,
        np.zeros((count, 3)),
        np.zeros((count, 3, 3)),
        np.where(track < good, 0.02, 5.0),
        np.full(count, 3),
        track < good,
        np.zeros((count, 15, 3)),
    )
