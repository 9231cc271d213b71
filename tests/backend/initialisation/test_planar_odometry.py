"""Planar odometry: planted motions are found among outliers, chains follow the truth and bridge empty frames."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.initialisation.planar_odometry import estimate_planar_motion, planar_odometry
from asfm.geometry.poses import invert, make_pose, transform
from asfm.types import FloatArray, Tracks


def _planar(x_m: float, y_m: float, yaw_rad: float) -> FloatArray:
    return make_pose(np.array([x_m, y_m, 0.0]), Rotation.from_euler("z", yaw_rad))


def _track_all(world_from_sonar: FloatArray, xy_m: FloatArray, visible: FloatArray) -> Tracks:
    """Observe points in the plane z = 0 exactly; visible is (tracks, frames)."""
    xyz_m = np.column_stack([xy_m, np.zeros(len(xy_m))])
    track, frame = np.nonzero(visible)
    seen = transform(invert(world_from_sonar)[frame], xyz_m[track])
    return Tracks(track, frame, np.linalg.norm(seen, axis=1), np.arctan2(seen[:, 1], seen[:, 0]))


@pytest.mark.parametrize("seed", range(5))
def test_planted_motion_is_found_among_half_outliers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    planted = _planar(*rng.uniform(-1, 1, 3).tolist())
    xy_b = rng.uniform([2, -3], [8, 3], (60, 2))
    xy_a = xy_b @ planted[:2, :2].T + planted[:2, 3] + rng.normal(0, 0.005, (60, 2))
    wrong = np.arange(60) < 30
    xy_a[wrong] = rng.uniform([2, -3], [8, 3], (30, 2))
    motion, inlier = estimate_planar_motion(xy_a, xy_b, np.full(60, 0.05), rng)
    assert inlier[~wrong].all()
    assert inlier[wrong].sum() <= 2
    np.testing.assert_allclose(motion[:2, :2], planted[:2, :2], atol=0.01)
    np.testing.assert_allclose(motion[:2, 3], planted[:2, 3], atol=0.03)
    np.testing.assert_allclose(motion[2], [0, 0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(motion[:, 2], [0, 0, 1, 0], atol=1e-12)


def test_motion_agrees_with_scipy_on_all_points() -> None:
    """Kabsch in the plane against SciPy's alignment in space."""
    rng = np.random.default_rng(9)
    planted = _planar(0.4, -0.3, 0.7)
    xy_b = rng.uniform([2, -3], [8, 3], (40, 2))
    xy_a = xy_b @ planted[:2, :2].T + planted[:2, 3] + rng.normal(0, 0.02, (40, 2))
    motion, inlier = estimate_planar_motion(xy_a, xy_b, np.full(40, 1.0), rng)
    assert inlier.all()
    lifted = [np.column_stack([xy - xy.mean(axis=0), np.zeros(40)]) for xy in (xy_a, xy_b)]
    rotation, _ = Rotation.align_vectors(*lifted)
    np.testing.assert_allclose(motion[:3, :3], rotation.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(motion[:2, 3], xy_a.mean(axis=0) - motion[:2, :2] @ xy_b.mean(axis=0), atol=1e-9)


def test_chain_follows_a_planar_path_with_a_lever_arm() -> None:
    rng = np.random.default_rng(1)
    steps = rng.uniform([-0.1, -0.1, -0.1], [0.3, 0.1, 0.1], (9, 3))
    world_from_vehicle = [_planar(3.0, -2.0, 1.0)]
    for step in steps.tolist():
        world_from_vehicle.append(world_from_vehicle[-1] @ _planar(*step))
    truth = np.stack(world_from_vehicle)
    lever_arm = make_pose(np.array([0.5, 0.1, 0.0]), Rotation.from_euler("z", 0.4))
    seen = rng.uniform([2, -2], [7, 2], (40, 2))
    xy_m = transform(truth[0] @ lever_arm, np.column_stack([seen, np.zeros(40)]))[:, :2]
    tracks = _track_all(truth @ lever_arm, xy_m, np.ones((40, 10)))
    poses, supported = planar_odometry(tracks, 10, truth[0], lever_arm, rng)
    assert supported.all()
    np.testing.assert_allclose(poses, truth, atol=1e-6)


def test_chain_keeps_the_pose_where_frames_share_nothing_and_continues() -> None:
    """Frames 0-4 see one set of points, 7-9 another, 5 and 6 none."""
    rng = np.random.default_rng(2)
    truth = np.stack([_planar(0.2 * frame, 0.0, 0.02 * frame) for frame in range(10)])
    xy_m = rng.uniform([3, -2], [8, 2], (40, 2))
    visible = np.zeros((40, 10))
    visible[:20, :5] = 1
    visible[20:, 7:] = 1
    poses, supported = planar_odometry(_track_all(truth, xy_m, visible), 10, np.eye(4), np.eye(4), rng)
    np.testing.assert_allclose(poses[:5], truth[:5], atol=1e-6)
    np.testing.assert_allclose(poses[5:8], np.repeat(poses[4:5], 3, axis=0), atol=1e-12)
    assert supported.tolist() == [True] * 5 + [False] * 3 + [True] * 2
    np.testing.assert_allclose(invert(poses[7]) @ poses[7:], invert(truth[7]) @ truth[7:], atol=1e-6)


def test_chain_prefers_supported_frames() -> None:
    """Frame 3 shares points only with those after it: frame 4 must follow from frame 2, not from the unsupported 3."""
    rng = np.random.default_rng(5)
    truth = np.stack([_planar(0.2 * frame, 0.0, 0.02 * frame) for frame in range(6)])
    visible = np.zeros((30, 6))
    visible[:15, [0, 1, 2, 4, 5]] = 1
    visible[15:, 3:] = 1
    tracks = _track_all(truth, rng.uniform([3, -2], [8, 2], (30, 2)), visible)
    poses, supported = planar_odometry(tracks, 6, np.eye(4), np.eye(4), rng)
    assert supported.tolist() == [True, True, True, False, True, True]
    np.testing.assert_allclose(poses[[0, 1, 2, 4, 5]], truth[[0, 1, 2, 4, 5]], atol=1e-6)


def test_chain_bridges_one_empty_frame() -> None:
    rng = np.random.default_rng(3)
    truth = np.stack([_planar(0.2 * frame, 0.0, 0.02 * frame) for frame in range(6)])
    visible = np.ones((20, 6))
    visible[:, 3] = 0
    tracks = _track_all(truth, rng.uniform([3, -2], [8, 2], (20, 2)), visible)
    poses, supported = planar_odometry(tracks, 6, np.eye(4), np.eye(4), rng)
    assert supported.tolist() == [True, True, True, False, True, True]
    np.testing.assert_allclose(poses[[0, 1, 2, 4, 5]], truth[[0, 1, 2, 4, 5]], atol=1e-6)


@pytest.mark.parametrize("frame_count", [1, 4])
def test_chain_without_tracks_stays_at_the_first_pose(frame_count: int) -> None:
    first = _planar(1.0, 2.0, 0.5)
    nothing = Tracks(np.zeros(0, int), np.zeros(0, int), np.zeros(0), np.zeros(0))
    poses, supported = planar_odometry(nothing, frame_count, first, np.eye(4), np.random.default_rng(0))
    np.testing.assert_allclose(poses, np.repeat(first[None], frame_count, axis=0), atol=1e-12)
    assert supported.tolist() == [True] + [False] * (frame_count - 1)


def test_same_seed_gives_the_same_bytes() -> None:
    rng = np.random.default_rng(4)
    xy_b = rng.uniform([2, -3], [8, 3], (30, 2))
    xy_a = rng.uniform([2, -3], [8, 3], (30, 2))
    first, again = (
        estimate_planar_motion(xy_a, xy_b, np.full(30, 0.3), np.random.default_rng(7))[0].tobytes() for _ in range(2)
    )
    assert first == again


def test_chain_continues_from_the_frame_that_a_motion_was_measured_from() -> None:
    """After two frames that see everything, odd frames see one half of the points and even frames the other."""
    rng = np.random.default_rng(6)
    truth = np.stack([_planar(0.2 * frame, 0.0, 0.05 * frame) for frame in range(9)])
    visible = np.ones((30, 9))
    visible[:15, 2::2] = 0
    visible[15:, 3::2] = 0
    poses, supported = planar_odometry(
        _track_all(truth, rng.uniform([3, -2], [8, 2], (30, 2)), visible), 9, np.eye(4), np.eye(4), rng
    )
    assert supported.all()
    np.testing.assert_allclose(poses, truth, atol=1e-6)


def test_chain_follows_the_nearest_frame() -> None:
    """The points that frame 4 shares with frame 0 alone have moved; those that it shares with frame 3 have not."""
    rng = np.random.default_rng(7)
    truth = np.stack([_planar(0.2 * frame, 0.0, 0.02 * frame) for frame in range(5)])
    visible = np.ones((30, 5))
    visible[15:, 1:4] = 0
    tracks = _track_all(truth, rng.uniform([3, -2], [8, 2], (30, 2)), visible)
    moved = (tracks.track >= 15) & (tracks.frame == 4)
    tracks = Tracks(tracks.track, tracks.frame, tracks.range_m, tracks.bearing_rad + 0.3 * moved)
    poses, _ = planar_odometry(tracks, 5, np.eye(4), np.eye(4), rng)
    np.testing.assert_allclose(poses, truth, atol=1e-6)


def test_tracks_without_a_common_motion_support_no_pose() -> None:
    rng = np.random.default_rng(8)
    track, frame = np.repeat(np.arange(6), 2), np.tile([0, 1], 6)
    tracks = Tracks(track, frame, rng.uniform(2, 8, 12), rng.uniform(-0.6, 0.6, 12))
    assert not planar_odometry(tracks, 2, np.eye(4), np.eye(4), rng)[1][1]


def test_points_may_be_off_the_motion_by_a_share_of_their_range() -> None:
    rng = np.random.default_rng(9)
    truth, xy_m = np.stack([_planar(0, 0, 0), _planar(0.2, 0, 0.05)]), rng.uniform([7, -3], [9, 3], (6, 2))
    exact = _track_all(truth, xy_m, np.ones((6, 2)))
    range_m = exact.range_m + np.where(exact.frame == 1, np.resize([0.1, 0.1, -0.1, -0.1], 12), 0.0)
    tracks = Tracks(exact.track, exact.frame, range_m, exact.bearing_rad)
    assert planar_odometry(tracks, 2, np.eye(4), np.eye(4), rng)[1].all()
