"""The whole pipeline on a small simulated sequence and on empty input: finite, repeatable, with its uncertainty."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.config import BackendConfig, Config
from asfm.geometry.poses import invert, make_pose, transform
from asfm.navigation.frame_navigation import read_navigation
from asfm.pipeline.reconstruction import reconstruct
from asfm.sequence import Sequence
from asfm.simulation.simulate import simulate
from asfm.types import (
    BoolArray,
    FloatArray,
    Frame,
    Keypoints,
    Matches,
    Navigation,
    Reconstruction,
    Trajectory,
)

FRAMES = 12
QUICK = Config(backend=BackendConfig(rounds=1))
QUICK_WITHOUT_SENSORS = Config(backend=BackendConfig(rounds=1, use_odometry=False, use_navigation=False))


def _with_frames(sequence: Sequence, frames: list[Frame]) -> Sequence:
    return replace(sequence, timestamps_s=sequence.timestamps_s[: len(frames)], read_frame=frames.__getitem__)


def _blank(frames: list[Frame], which: range) -> list[Frame]:
    return [replace(f, image=np.zeros_like(f.image)) if f.index in which else f for f in frames]


@pytest.fixture(scope="module")
def tank() -> Sequence:
    """A sway before a tank's targets, its frames in memory; the vehicle carries the sonar on a lever arm."""
    lever_arm = make_pose(np.array([0.3, 0.0, -0.1]), Rotation.from_euler("ZYX", [0.0, 0.1, 0.0]))
    sequence = simulate("tank", frame_count=FRAMES, seed=1, vehicle_from_sonar=lever_arm).sequence
    return _with_frames(sequence, list(sequence))


@pytest.fixture(scope="module")
def result(tank: Sequence) -> Reconstruction:
    return reconstruct(tank, Config()).reconstruction


def _place_error_m(poses: FloatArray, truth: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum((poses - truth)[:, :3, 3] ** 2, axis=1))))


def _check_finite(reconstruction: Reconstruction, frame_count: int) -> None:
    poses = reconstruction.trajectory.world_from_vehicle
    assert poses.shape == (frame_count, 4, 4) and np.isfinite(poses).all()
    np.testing.assert_allclose(invert(poses) @ poses, np.tile(np.eye(4), (frame_count, 1, 1)), atol=1e-9)
    landmarks = reconstruction.landmarks
    for values in (landmarks.xyz_m, landmarks.covariance_m2, landmarks.sigma_m, landmarks.arc_m):
        assert len(values) == len(landmarks) and np.isfinite(values).all()


def test_a_small_sequence_is_reconstructed(tank: Sequence, result: Reconstruction) -> None:
    assert tank.groundtruth is not None and tank.odometry is not None
    _check_finite(result, FRAMES)
    np.testing.assert_array_equal(result.trajectory.timestamps_s, tank.timestamps_s)
    assert len(result.landmarks) > 30 and result.diagnostics == ()
    truth = tank.groundtruth.world_from_vehicle
    found_m, odometry_m = (
        _place_error_m(poses, truth)
        for poses in (result.trajectory.world_from_vehicle, tank.odometry.world_from_vehicle)
    )
    assert found_m < 0.5 * odometry_m  # 0.21 to 0.36 over other seeds


def test_same_input_same_bytes(tank: Sequence, result: Reconstruction) -> None:
    again = reconstruct(tank, Config()).reconstruction
    assert again.trajectory.world_from_vehicle.tobytes() == result.trajectory.world_from_vehicle.tobytes()
    assert again.landmarks.xyz_m.tobytes() == result.landmarks.xyz_m.tobytes()
    assert again.landmarks.covariance_m2.tobytes() == result.landmarks.covariance_m2.tobytes()


def test_world_is_that_of_the_odometry(tank: Sequence, result: Reconstruction) -> None:
    """Odometry and heading elsewhere in the world: the result is there too, and otherwise the same."""
    assert tank.odometry is not None
    elsewhere = make_pose(np.array([500.0, -80.0, 0.0]), Rotation.from_rotvec([0.0, 0.0, 2.0]))
    poses = elsewhere @ tank.odometry.world_from_vehicle
    moved = reconstruct(replace(tank, odometry=replace(tank.odometry, world_from_vehicle=poses)), Config())
    found = moved.reconstruction
    assert _place_error_m(found.trajectory.world_from_vehicle[:1], poses[:1]) < 0.1
    expected = elsewhere @ result.trajectory.world_from_vehicle
    np.testing.assert_allclose(found.trajectory.world_from_vehicle, expected, atol=2e-3)
    same = np.intersect1d(found.landmarks.track, result.landmarks.track)
    assert len(same) > 0.9 * len(result.landmarks)
    shift_m = np.linalg.norm(
        np.median(found.landmarks.xyz_m, axis=0) - np.median(transform(elsewhere, result.landmarks.xyz_m), axis=0)
    )
    assert shift_m < 0.05


def test_sonar_alone_starts_at_the_identity(tank: Sequence) -> None:
    bare = replace(tank, odometry=None, navigation=None)
    found = reconstruct(bare, QUICK).reconstruction
    _check_finite(found, FRAMES)
    np.testing.assert_allclose(found.trajectory.world_from_vehicle[0], np.eye(4), atol=1e-4)
    assert len(found.landmarks) > 30
    unwanted = reconstruct(tank, QUICK_WITHOUT_SENSORS).reconstruction
    assert unwanted.trajectory.world_from_vehicle.tobytes() == found.trajectory.world_from_vehicle.tobytes()


@pytest.mark.parametrize("frame_count", [1, 2, 5])
def test_black_images_give_identity_poses_and_a_warning(tank: Sequence, frame_count: int) -> None:
    black = _with_frames(tank, _blank(list(tank), range(FRAMES))[:frame_count])
    found = reconstruct(replace(black, odometry=None, navigation=None), Config()).reconstruction
    _check_finite(found, frame_count)
    np.testing.assert_allclose(found.trajectory.world_from_vehicle, np.tile(np.eye(4), (frame_count, 1, 1)), atol=1e-9)
    assert len(found.landmarks) == 0
    assert [item.code for item in found.diagnostics] == ["single-frame" if frame_count == 1 else "unsupported-steps"]


@pytest.mark.parametrize("frame_count", [1, 5])
def test_black_images_give_the_odometry_and_a_warning(tank: Sequence, frame_count: int) -> None:
    black = replace(_with_frames(tank, _blank(list(tank), range(FRAMES))[:frame_count]), navigation=None)
    found = reconstruct(black, Config()).reconstruction
    odometry = read_navigation(black, BackendConfig()).odometry
    assert odometry is not None
    expected = odometry.world_from_vehicle
    np.testing.assert_allclose(found.trajectory.world_from_vehicle, expected, atol=1e-6)
    assert len(found.landmarks) == 0
    assert [item.code for item in found.diagnostics] == ["single-frame" if frame_count == 1 else "unsupported-steps"]


def test_one_frame_with_echoes_has_nothing_to_match(tank: Sequence) -> None:
    found = reconstruct(_with_frames(tank, list(tank)[:1]), Config()).reconstruction
    _check_finite(found, 1)
    assert [item.code for item in found.diagnostics] == ["single-frame"]


@pytest.mark.parametrize("odometry", [True, False])
def test_black_frames_in_the_middle_are_named(tank: Sequence, odometry: bool) -> None:
    """Without a match across the gap the two halves hang on the odometry, or the pose is held."""
    frames = _blank(list(tank), range(4, 9))
    gap = _with_frames(tank if odometry else replace(tank, odometry=None, navigation=None), frames)
    config = Config.model_validate({"matching": {"max_gap": 4}, "backend": {"rounds": 1}})
    found = reconstruct(gap, config).reconstruction
    _check_finite(found, FRAMES)
    assert found.diagnostics[0].code == "unsupported-steps"
    assert found.diagnostics[0].frames == ((3, 9),)
    assert "between frames 3-9" in found.diagnostics[0].message
    poses = found.trajectory.world_from_vehicle
    if odometry:
        read = read_navigation(gap, BackendConfig()).odometry
        assert read is not None
        expected = read.world_from_vehicle
        assert np.linalg.norm((invert(poses[3]) @ poses[8] - invert(expected[3]) @ expected[8])[:3, 3]) < 0.1
    else:
        np.testing.assert_allclose(poses[4:9], np.repeat(poses[3:4], 5, axis=0), atol=5e-3)


@pytest.mark.parametrize("sensors", [True, False])
def test_one_image_again_and_again_leaves_every_elevation_open(tank: Sequence, sensors: bool) -> None:
    """A sonar that stands still: no direction but range and bearing is measured, and nothing may break on that."""
    first = tank.read_frame(0)
    frames = [replace(first, index=index, timestamp_s=float(tank.timestamps_s[index])) for index in range(6)]
    still = Trajectory(tank.timestamps_s[:6], np.tile(np.eye(4), (6, 1, 1)))
    sequence = replace(_with_frames(tank, frames), navigation=None, odometry=still if sensors else None)
    found = reconstruct(sequence, QUICK).reconstruction
    _check_finite(found, 6)
    np.testing.assert_allclose(found.trajectory.world_from_vehicle, still.world_from_vehicle, atol=5e-3)
    assert len(found.landmarks) > 10 and not found.landmarks.well_constrained.any()


def test_one_black_frame_is_bridged(tank: Sequence) -> None:
    found = reconstruct(_with_frames(tank, _blank(list(tank), range(5, 6))), QUICK).reconstruction
    _check_finite(found, FRAMES)
    assert found.diagnostics == ()
    assert 5 not in found.tracks.frame


def test_black_frames_with_navigation_alone_follow_depth_and_attitude(tank: Sequence) -> None:
    stamps = tank.timestamps_s
    navigation = Navigation(
        stamps, -1 - 0.01 * np.arange(FRAMES, dtype=np.float64), np.full(FRAMES, 0.1), np.full(FRAMES, -0.2)
    )
    black = replace(_with_frames(tank, _blank(list(tank), range(FRAMES))), odometry=None, navigation=navigation)
    found = reconstruct(black, Config()).reconstruction
    _check_finite(found, FRAMES)
    angles = Rotation.from_matrix(found.trajectory.world_from_vehicle[:, :3, :3]).as_euler("ZYX")
    np.testing.assert_allclose(angles, np.tile([0.0, -0.2, 0.1], (FRAMES, 1)), atol=1e-3)
    assert found.trajectory.world_from_vehicle[0, 2, 3] == pytest.approx(-1.0, abs=0.1)


class _RecordingObserver:
    """Recorder that keeps the order of its calls."""

    def __init__(self) -> None:
        self.frames: list[int] = []
        self.pairs: list[tuple[int, int]] = []
        self.results: list[Reconstruction] = []

    def record_frame(self, frame: Frame, mask: BoolArray, keypoints: Keypoints) -> None:
        assert mask.shape == frame.image.shape and mask.dtype == np.bool_
        assert not self.results
        self.frames.append(frame.index)

    def record_matches(self, frame_a: Keypoints, frame_b: Keypoints, matches: Matches) -> None:
        assert matches.frame_b == self.frames[-1]
        if len(matches):
            assert matches.index[:, 0].max() < len(frame_a) and matches.index[:, 1].max() < len(frame_b)
        self.pairs.append((matches.frame_a, matches.frame_b))

    def record_reconstruction(self, sequence: Sequence, reconstruction: Reconstruction) -> None:
        self.results.append(reconstruction)

    def close(self) -> None:
        raise AssertionError("the caller that opened the recorder closes it")


def test_recorder_receives_every_frame_in_order_and_the_result(tank: Sequence) -> None:
    observer = _RecordingObserver()
    progress: list[tuple[str, int, int]] = []
    run = reconstruct(
        _with_frames(tank, _blank(list(tank)[:5], range(2, 3))),
        Config(),
        observer,
        lambda stage, done, total: progress.append((stage, done, total)),
    )
    assert observer.frames == [0, 1, 2, 3, 4]
    assert observer.pairs == [(0, 1), (1, 2), (2, 3), (3, 4)]
    assert observer.results == [run.reconstruction]
    assert [done for stage, done, total in progress if stage == "front-end" and total == 5] == [1, 2, 3, 4, 5]
    names = [stage.name for stage in run.stages]
    assert names == [
        "noise",
        "front-end",
        "initialisation",
        "round 1",
        "loops",
        "round 2",
        "round 3",
        "conventions",
        "landmarks",
        "record",
    ]
    assert all(stage.wall_s >= 0 for stage in run.stages)
    assert run.stages[1].counts["frames"] == 5


def test_odometry_at_other_stamps_is_interpolated_by_time(tank: Sequence) -> None:
    """Odometry four times as dense, beginning before and ending after the frames: rows do not correspond."""
    assert tank.odometry is not None
    stamps = np.arange(-1.0, float(tank.timestamps_s[-1]) + 1, 0.05)
    poses = make_pose(np.outer(stamps, [0.1, 0.2, 0.0]), Rotation.from_rotvec(np.outer(stamps, [0.0, 0.0, 0.1])))
    black = _with_frames(tank, _blank(list(tank), range(FRAMES)))
    found = reconstruct(replace(black, odometry=Trajectory(stamps, poses), navigation=None), Config())
    place_m = found.reconstruction.trajectory.world_from_vehicle[:, :3, 3]
    np.testing.assert_allclose(place_m, np.outer(tank.timestamps_s, [0.1, 0.2, 0.0]), atol=1e-6)
