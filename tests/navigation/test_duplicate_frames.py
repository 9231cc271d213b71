"""Duplicate frames: found bit by bit, and their matches dropped only where odometry moved meanwhile."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.config import BackendConfig
from asfm.geometry.poses import make_pose
from asfm.navigation.duplicate_frames import MIN_KEYPOINTS, drop_duplicate_frames, find_duplicate_frames
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.odometry import Odometry
from asfm.types import FloatArray, Keypoints, Matches, Trajectory
from tests.worlds import make_vehicle_path, make_vehicle_sequence

CANDIDATES = [Matches(a, a + 1, np.zeros((0, 2), np.int64), np.zeros(0)) for a in range(7)]


def make_keypoints(seed: int, count: int = 20) -> Keypoints:
    rng = np.random.default_rng(seed)
    place = rng.uniform(1, 5, (count, 2))
    descriptors, patches = np.zeros((count, 8), np.uint8), np.zeros((0, 3, 3), np.float32)
    return Keypoints(place, place[:, 0], place[:, 1], np.ones(count), descriptors, patches)


KEYPOINTS = [make_keypoints(seed) for seed in (0, 1, 1, 1, 2, 3, 3, 4)]


def read_odometry(poses: FloatArray) -> Odometry | None:
    stamps_s = np.arange(8.0)
    sequence = replace(
        make_vehicle_sequence(), timestamps_s=stamps_s, odometry=Trajectory(stamps_s, poses), navigation=None
    )
    return read_navigation(sequence, BackendConfig()).odometry


def test_frames_with_the_keypoints_of_the_frame_before_are_duplicates() -> None:
    assert np.flatnonzero(find_duplicate_frames(KEYPOINTS)).tolist() == [2, 3, 6]
    assert find_duplicate_frames([]).shape == (0,) and find_duplicate_frames(KEYPOINTS[:1]).tolist() == [False]


def test_last_bit_and_few_keypoints_prevent_a_duplicate() -> None:
    one = make_keypoints(0)
    farther = replace(one, range_m=np.nextafter(one.range_m, np.inf))
    turned = replace(one, bearing_rad=np.nextafter(one.bearing_rad, np.inf))
    assert not find_duplicate_frames([one, farther, turned, one]).any()
    few = make_keypoints(0, MIN_KEYPOINTS - 1)
    assert not find_duplicate_frames([few, few]).any()


def test_matches_of_duplicates_are_dropped_where_odometry_moves() -> None:
    kept, diagnostics = drop_duplicate_frames(KEYPOINTS, CANDIDATES, read_odometry(make_vehicle_path()[:8]))
    assert [match.frame_a for match in kept] == [0, 4]
    (found,) = diagnostics
    assert found.code == "duplicate-frames" and found.frames == ((2, 3), (6, 6))
    assert "3 of 8 frames (2-3, 6)" in found.message


@pytest.mark.parametrize("moving", ["never", "between other frames"])
def test_all_matches_stay_where_odometry_does_not_move(moving: str) -> None:
    poses = np.tile(np.eye(4), (8, 1, 1))
    if moving == "between other frames":
        poses[1:, 0, 3], poses[4:, 0, 3], poses[5:, 0, 3], poses[7:, 0, 3] = 0.3, 0.6, 0.9, 1.2
    assert drop_duplicate_frames(KEYPOINTS, CANDIDATES, read_odometry(poses)) == (CANDIDATES, ())


def test_without_odometry_duplicates_are_told_and_all_matches_stay() -> None:
    kept, (found,) = drop_duplicate_frames(KEYPOINTS, CANDIDATES, None)
    assert kept == CANDIDATES and found.code == "duplicate-frames" and found.frames == ((2, 3), (6, 6))
    assert "at rest" in found.message and "3 of 8 frames (2-3, 6)" in found.message
    different = [KEYPOINTS[0], KEYPOINTS[1], KEYPOINTS[4]]
    assert drop_duplicate_frames(different, CANDIDATES, None) == (CANDIDATES, ())


def test_matches_of_duplicates_are_dropped_where_odometry_turns_on_the_spot() -> None:
    turned = make_pose(np.zeros((8, 3)), Rotation.from_rotvec(np.outer(0.05 * np.arange(8), [0.0, 0.0, 1.0])))
    kept, diagnostics = drop_duplicate_frames(KEYPOINTS, CANDIDATES, read_odometry(turned))
    assert [match.frame_a for match in kept] == [0, 4]
    assert [found.code for found in diagnostics] == ["duplicate-frames"]
