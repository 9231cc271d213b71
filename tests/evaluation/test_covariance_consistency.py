"""Consistency of covariances: NEES of poses with known errors, landmarks moved by known distances."""

from collections.abc import Callable
from dataclasses import replace

import gtsam
import numpy as np
import pytest

from asfm.evaluation.covariance_consistency import (
    evaluate_consistency,
    measure_landmarks,
    measure_nees,
    pool_landmarks,
)
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import project
from asfm.simulation.track_simulation import TrackSimulation, simulate_tracks
from asfm.types import FloatArray, FrameTruth, Landmarks, Trajectory

SIGMA = np.array([0.01, 0.03, 0.02, 0.3, 0.1, 0.05])


def make_poses(error: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Make random poses, and the truth that lies at (N, 6) errors in the tangent space at them."""
    rng = np.random.default_rng(2)
    poses = [gtsam.Pose3.Expmap(rng.normal(size=6)) for _ in error]
    truth = [pose.retract(vector).matrix() for pose, vector in zip(poses, error, strict=True)]
    return np.stack([pose.matrix() for pose in poses]), np.stack(truth)


def covariances(count: int) -> FloatArray:
    return np.tile(np.diag(SIGMA**2), (count, 1, 1))


def test_nees_is_one_where_covariances_are_true() -> None:
    error = SIGMA * np.random.default_rng(0).normal(size=(400, 6))
    error[0] = 100 * SIGMA  # of the first pose, which does not count
    nees = measure_nees(*make_poses(error), covariances(400))
    assert nees is not None
    assert nees.position == pytest.approx(np.mean((error / SIGMA)[1:, 3:] ** 2), rel=1e-6)
    assert (nees.position, nees.attitude) == pytest.approx((1, 1), abs=0.12)
    doubled = measure_nees(*make_poses(error * [1, 1, 1, 2, 2, 2]), covariances(400))
    assert doubled is not None
    assert (doubled.position, doubled.attitude) == pytest.approx((4, 1), rel=0.12), "positions alone are doubled"


def test_nees_uses_the_correlations_within_a_covariance() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(scale=0.05, size=(6, 6))
    covariance = root @ root.T
    error = rng.normal(size=(400, 6)) @ root.T
    nees = measure_nees(*make_poses(error), np.tile(covariance, (400, 1, 1)))
    assert nees is not None and (nees.position, nees.attitude) == pytest.approx((1, 1), abs=0.15)


def test_without_usable_covariances_there_is_no_nees() -> None:
    poses, truth = make_poses(SIGMA * np.ones((3, 6)))
    for value in (0.0, np.inf, np.nan):
        unusable = covariances(3)
        unusable[2] = value * np.eye(6) if value == 0 else value
        assert measure_nees(poses, truth, unusable) is None
    unusable = covariances(3)
    unusable[0] = np.inf  # of the first pose, which does not count
    assert measure_nees(poses, truth, unusable) is not None
    assert measure_nees(poses[:1], truth[:1], covariances(1)) is None


@pytest.fixture(scope="module")
def floor() -> TrackSimulation:
    return simulate_tracks(12, 20, (6, 12), "sway", 1.0, navigation=True)


def true_poses(floor: TrackSimulation) -> FloatArray:
    assert floor.sequence.groundtruth is not None
    return floor.sequence.groundtruth.world_from_vehicle


def truth_reader(floor: TrackSimulation) -> Callable[[int], FrameTruth]:
    """Return a reader of frames in which only the points echo, each from the pixel in which it was observed."""
    sonar, tracks = floor.sequence.sonar, floor.tracks
    sonar_from_world = invert(true_poses(floor))
    elevation_rad = project(transform(sonar_from_world[tracks.frame], floor.xyz_m[tracks.track]))[2]
    row = np.minimum(sonar.row_at_range(tracks.range_m).astype(int), sonar.shape[0] - 1)
    column = np.minimum(sonar.column_at_bearing(tracks.bearing_rad).astype(int), sonar.shape[1] - 1)

    def read_truth(index: int) -> FrameTruth:
        here, image = tracks.frame == index, np.full(sonar.shape, np.nan)
        image[row[here], column[here]] = elevation_rad[here]
        return FrameTruth(image, np.zeros(sonar.shape, np.float32))

    return read_truth


def displaced_landmarks(floor: TrackSimulation) -> Landmarks:
    """Make landmarks 2 cm above their points, every fourth 50 cm; every second one counts as well constrained."""
    every = np.arange(floor.tracks.count)
    return Landmarks(
        track=every,
        xyz_m=floor.xyz_m + np.where(every % 4 == 0, 0.5, 0.02)[:, None] * [0, 0, 1],
        covariance_m2=np.tile(0.01 * np.eye(3), (len(every), 1, 1)),
        sigma_m=np.full(len(every), 0.1),
        views=np.bincount(floor.tracks.track),
        well_constrained=every % 2 == 0,
        arc_m=np.zeros((len(every), 1, 3)),
    )


def test_landmark_errors_are_the_displacements(floor: TrackSimulation) -> None:
    landmarks, read_truth = displaced_landmarks(floor), truth_reader(floor)
    count = floor.tracks.count
    found = measure_landmarks(landmarks, floor.tracks, floor.sequence, read_truth)
    assert found.tracks == count
    assert found.well_constrained == len(found.error_m) == np.sum(np.arange(count) % 2 == 0)
    assert found.within_3_sigma == pytest.approx(0.5, abs=0.06)
    assert found.median_error_m is not None and 0.01 < found.median_error_m < 0.55

    nothing = replace(landmarks, well_constrained=np.zeros(count, bool))
    empty = measure_landmarks(nothing, floor.tracks, floor.sequence, read_truth)
    assert (empty.well_constrained_share, empty.within_3_sigma, empty.median_error_m) == (0, None, None)
    pooled = pool_landmarks([found, empty, found])
    assert found.well_constrained_share is not None
    assert pooled.well_constrained_share == pytest.approx(found.well_constrained_share * 2 / 3)
    assert pooled.within_3_sigma == found.within_3_sigma


def test_landmarks_in_a_world_of_their_own_are_aligned(floor: TrackSimulation) -> None:
    landmarks, read_truth, poses = displaced_landmarks(floor), truth_reader(floor), true_poses(floor)
    expected = measure_landmarks(landmarks, floor.tracks, floor.sequence, read_truth)
    moved = replace(landmarks, xyz_m=transform(invert(poses[0]), landmarks.xyz_m))
    aligned = measure_landmarks(moved, floor.tracks, floor.sequence, read_truth, poses[0])
    assert aligned.median_error_m == pytest.approx(expected.median_error_m, rel=1e-6)
    assert measure_landmarks(moved, floor.tracks, floor.sequence, read_truth).within_3_sigma == 0


def test_rows_of_a_simulation_in_its_own_world_and_in_the_true_one(floor: TrackSimulation) -> None:
    rng, truth = np.random.default_rng(3), true_poses(floor)
    error = SIGMA * rng.normal(size=(12, 6))
    error[0] = 0
    poses = np.stack([gtsam.Pose3(pose).retract(e).matrix() for pose, e in zip(truth, error, strict=True)])
    landmarks, read_truth = displaced_landmarks(floor), truth_reader(floor)
    rows = evaluate_consistency(poses, covariances(12), landmarks, floor.tracks, floor.sequence, read_truth, False)
    found, nees = measure_landmarks(landmarks, floor.tracks, floor.sequence, read_truth), (error / SIGMA)[1:] ** 2
    assert {row.key: row.value for row in rows} == pytest.approx(
        {
            "nees_position": nees[:, 3:].mean(),
            "nees_attitude": nees[:, :3].mean(),
            "landmarks_well_constrained_share": found.well_constrained_share,
            "landmarks_within_3_sigma": found.within_3_sigma,
            "landmark_error_median_m": found.median_error_m,
        },
        rel=0.02,  # the error's tangent is at the truth here, and at the estimate in the NEES
    )
    elsewhere = np.linalg.inv(truth[0])
    moved = replace(landmarks, xyz_m=transform(elsewhere, landmarks.xyz_m))
    again = evaluate_consistency(
        elsewhere @ poses, covariances(12), moved, floor.tracks, floor.sequence, read_truth, True
    )
    np.testing.assert_allclose([row.value for row in again], [row.value for row in rows], rtol=1e-6)


def test_rows_of_a_recording_are_those_that_true_poses_allow(floor: TrackSimulation) -> None:
    truth, landmarks = true_poses(floor), displaced_landmarks(floor)
    stamps_s = floor.sequence.timestamps_s

    def keys(groundtruth: Trajectory | None) -> list[str]:
        sequence = replace(floor.sequence, groundtruth=groundtruth)
        rows = evaluate_consistency(truth, covariances(12), landmarks, floor.tracks, sequence, None, True)
        return [row.key for row in rows]

    assert keys(Trajectory(stamps_s, truth)) == ["nees_position", "nees_attitude"]
    assert keys(Trajectory(stamps_s[:6], truth[:6])) == ["nees_position", "nees_attitude"]
    assert keys(Trajectory(stamps_s[1:], truth[1:])) == [], "covariances are relative to the first pose"
    assert keys(None) == []


def test_only_frames_within_the_time_of_the_truth_count(floor: TrackSimulation) -> None:
    truth, landmarks = true_poses(floor), displaced_landmarks(floor)
    poses = truth.copy()
    poses[6:, :3, 3] += 5.0
    half = Trajectory(floor.sequence.timestamps_s[:6], truth[:6])
    sequence = replace(floor.sequence, groundtruth=half)
    rows = evaluate_consistency(poses, covariances(12), landmarks, floor.tracks, sequence, None, False)
    assert [row.value for row in rows] == pytest.approx([0, 0], abs=1e-9)


def test_a_point_that_a_single_observation_agrees_with_is_not_that_of_its_track(floor: TrackSimulation) -> None:
    """All observations of one track but its first are moved to places where nothing echoes."""
    landmarks, read_truth, tracks = displaced_landmarks(floor), truth_reader(floor), floor.tracks
    moved = (tracks.track == 2) & (np.diff(tracks.track, prepend=-1) == 0)
    spoiled = replace(tracks, range_m=tracks.range_m + np.where(moved, 0.7 + 0.3 * tracks.frame, 0.0))
    before, after = (measure_landmarks(landmarks, each, floor.sequence, read_truth) for each in (tracks, spoiled))
    assert moved.sum() > 1 and len(after.error_m) == len(before.error_m) - 1
    np.testing.assert_allclose(after.error_m, np.delete(before.error_m, 1))
