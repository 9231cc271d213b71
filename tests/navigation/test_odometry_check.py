"""Odometry of a wrong frame, a wrong clock or none: found by images or navigation, named, and survived."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.initialisation.initial_poses import (
    InitialPoses,
    initialise_from_odometry,
    replace_unreliable_steps,
    verify_odometry,
)
from asfm.config import BackendConfig, Config
from asfm.geometry.poses import depth_roll_pitch, invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, project
from asfm.navigation.depth_attitude import DepthAttitude
from asfm.navigation.duplicate_frames import drop_duplicate_frames, find_duplicate_frames
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.odometry_hypotheses import PointPairs, planar_inliers
from asfm.navigation.sensor_consistency import align_initial_attitude, compare_odometry_attitude, estimate_time_offset
from asfm.sequence import Sequence
from asfm.simulation.vehicle.sensors import simulate_navigation, simulate_odometry
from asfm.types import FloatArray, Keypoints, Matches, Navigation, SensorNoise, Tracks, Trajectory
from tests.worlds import no_frame

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.6, 0.6), (700, 256), np.deg2rad(16))
LEVER_ARM = make_pose(np.array([0.4, 0.1, -0.2]), Rotation.from_euler("ZYX", [0.0, 0.3, 0.0]))
NOISE = SensorNoise(0.02, 0.005, 0.01, 0.003, 0.003)
COUNT = 40


def make_path() -> FloatArray:
    """Truth of a vehicle that weaves over the floor, turns, rolls and heaves: no axis is idle."""
    t = np.linspace(0, 4 * np.pi, COUNT)
    place = np.stack([0.08 * np.arange(COUNT), 0.5 * np.sin(t / 2), 2.0 + 0.25 * np.sin(0.8 * t)], axis=1)
    angles = np.stack([0.3 * np.sin(t / 2 + 1), 0.1 * np.sin(t), 0.2 * np.cos(0.7 * t)], axis=1)
    return make_pose(place, Rotation.from_euler("ZYX", angles))


def make_sequence(seed: int = 0, noise: SensorNoise = NOISE) -> Sequence:
    rng = np.random.default_rng(seed)
    truth = Trajectory(np.asarray(0.2 * np.arange(COUNT), dtype=np.float64), make_path())
    return Sequence(
        "made up",
        SONAR,
        truth.timestamps_s,
        no_frame,
        LEVER_ARM,
        odometry=simulate_odometry(truth, noise, rng),
        navigation=simulate_navigation(truth, noise, rng),
        groundtruth=truth,
        noise=NOISE,
    )


def see_floor(seed: int = 0) -> Tracks:
    """Points of a bumpy floor as the true poses see them, with the noise of features."""
    rng = np.random.default_rng(100 + seed)
    xyz_m = rng.uniform([0, -6, -0.3], [14, 6, 0.3], (800, 3))
    seen = transform(invert(make_path() @ LEVER_ARM), xyz_m[:, None])
    track, frame = np.nonzero(SONAR.sees(seen))
    track = np.unique(track, return_inverse=True)[1].astype(np.int64)
    range_m, bearing_rad, _ = project(seen[np.nonzero(SONAR.sees(seen))])
    error = rng.normal(0, [0.015, 0.005], (len(track), 2))
    return Tracks(track, frame.astype(np.int64), range_m + error[:, 0], bearing_rad + error[:, 1])


def list_pairs(tracks: Tracks) -> list[PointPairs]:
    pixels = np.stack([tracks.range_m, tracks.bearing_rad], axis=1)
    pairs = []
    for gap in (1, 2, 4):
        for b in range(gap, COUNT):
            in_a, in_b = (np.flatnonzero(tracks.frame == index) for index in (b - gap, b))
            _, a, of_b = np.intersect1d(tracks.track[in_a], tracks.track[in_b], return_indices=True)
            pairs.append(PointPairs(b - gap, b, pixels[in_a[a]], pixels[in_b[of_b]], np.eye(4)))
    return pairs


class Floor(NamedTuple):
    """What the sonar sees, whatever the odometry says."""

    tracks: Tracks
    pairs: list[PointPairs]


@pytest.fixture(scope="module")
def floor() -> Floor:
    tracks = see_floor()
    return Floor(tracks, list_pairs(tracks))


def with_odometry(sequence: Sequence, change: Callable[[FloatArray], FloatArray]) -> Sequence:
    assert sequence.odometry is not None
    poses = change(sequence.odometry.world_from_vehicle)
    return replace(sequence, odometry=replace(sequence.odometry, world_from_vehicle=poses))


def check(sequence: Sequence, floor: Floor) -> InitialPoses:
    start = initialise_from_odometry(read_navigation(sequence, BackendConfig()), sequence)
    assert start is not None
    start = verify_odometry(start, sequence, floor.pairs, Config(), np.random.default_rng(0))
    if start.unreliable.any():
        start = replace_unreliable_steps(start, sequence, floor.tracks, np.random.default_rng(0))
    for values in (start.world_from_vehicle, start.sensors.steps, start.sensors.step_sigma, start.sensors.z_roll_pitch):
        assert np.isfinite(values).all()
    assert start.world_from_vehicle.shape == (COUNT, 4, 4) and (start.sensors.step_sigma > 0).all()
    return start


def mirror_axis(axis: int) -> Callable[[FloatArray], FloatArray]:
    sign = np.where(np.arange(3) == axis, -1.0, 1.0)
    return lambda poses: make_pose(poses[:, :3, 3] * sign, Rotation.from_matrix(poses[:, :3, :3]))


def mirror_heading(poses: FloatArray) -> FloatArray:
    angles = Rotation.from_matrix(poses[:, :3, :3]).as_euler("ZYX") * [-1, 1, 1]
    return make_pose(poses[:, :3, 3], Rotation.from_euler("ZYX", angles))


def turn_body(poses: FloatArray) -> FloatArray:
    return poses @ make_pose(np.zeros(3), Rotation.from_euler("z", -np.pi / 2))


LEFT_HANDED = np.diag([1.0, -1.0, 1.0, 1.0])


@pytest.mark.parametrize("seed", range(4))
def test_right_odometry_is_believed(floor: Floor, seed: int) -> None:
    sequence = make_sequence(seed)
    start = check(sequence, floor)
    assert start.sensors.diagnostics == () and not start.unreliable.any()
    assert sequence.odometry is not None
    np.testing.assert_allclose(start.world_from_vehicle, sequence.odometry.world_from_vehicle, atol=1e-12)
    np.testing.assert_array_equal(start.sensors.step_sigma, np.tile([0.005, 0.02], (COUNT - 1, 1)))


def test_odometry_twice_as_noisy_as_it_says_is_no_fault_of_its_frame(floor: Floor) -> None:
    noisy = make_sequence(1, SensorNoise(0.04, 0.01, 0.01, 0.003, 0.003))
    assert check(noisy, floor).sensors.diagnostics == ()


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (mirror_axis(0), "with its x axis mirrored"),
        (mirror_axis(1), "with its y axis mirrored"),
        (mirror_heading, "with its heading mirrored"),
        (lambda poses: LEFT_HANDED @ poses @ LEFT_HANDED, "with port and starboard swapped"),
        (invert, "inverted"),
        (turn_body, "with its body axes turned by 90 deg about z"),
    ],
    ids=["x", "y", "heading", "left-handed", "inverted", "turned"],
)
@pytest.mark.parametrize("navigation", [True, False])
def test_odometry_of_a_wrong_frame_is_named_and_doubted(
    floor: Floor, change: Callable[[FloatArray], FloatArray], named: str, navigation: bool
) -> None:
    sequence = with_odometry(make_sequence(), change)
    if not navigation:
        sequence = replace(sequence, navigation=None)
    start = check(sequence, floor)
    message = next(found.message for found in start.sensors.diagnostics if found.code == "odometry-image-conflict")
    assert named in message and " m " in message
    assert np.median(start.sensors.step_sigma[:, 1]) > 0.03
    steps, truth = (invert(p[:-1]) @ p[1:] for p in (start.world_from_vehicle, make_path()))
    off_m = np.linalg.norm((steps - truth)[:, :3, 3], axis=1)
    assert np.median(off_m) < 0.06, "the start follows the images, not the wrong steps"


def test_mirrored_height_is_found_by_navigation_and_settled_by_the_images(floor: Floor) -> None:
    start = check(with_odometry(make_sequence(), mirror_axis(2)), floor)
    message = next(found.message for found in start.sensors.diagnostics if found.code == "sensor-conflict")
    assert "depth" in message and "one is mirrored" in message
    change, truth = (np.diff(poses[::8, 2, 3]) for poses in (start.world_from_vehicle, make_path()))
    held = np.isfinite(start.sensors.z_roll_pitch_sigma[:, 0]).all()
    assert held and (start.unreliable.all() or np.corrcoef(change, truth)[0, 1] > 0.9)


@pytest.mark.parametrize("column", ["z_m", "roll_rad"])
def test_mirrored_navigation_is_left_out(floor: Floor, column: str) -> None:
    sequence = make_sequence()
    assert sequence.navigation is not None
    wrong = replace(sequence.navigation, **{column: -getattr(sequence.navigation, column)})
    start = check(replace(sequence, navigation=wrong), floor)
    (found,) = start.sensors.diagnostics
    assert found.code == "sensor-conflict"
    assert "one is mirrored" in found.message and "left out" in found.message
    free = np.isinf(start.sensors.z_roll_pitch_sigma).all(axis=0)
    assert free.tolist() == [column == "z_m", column == "roll_rad", False]


def test_odometry_that_starts_elsewhere_is_moved_to_navigation(floor: Floor) -> None:
    sequence = make_sequence()
    other = make_pose(np.array([0.0, 0.0, 12.0]), Rotation.from_euler("ZYX", [0.0, 0.2, -0.1]))
    start = check(with_odometry(sequence, lambda poses: other @ poses), floor)
    (found,) = start.sensors.diagnostics
    assert found.code == "odometry-frame-offset" and "of depth" in found.message
    np.testing.assert_allclose(
        depth_roll_pitch(start.world_from_vehicle[:5]), depth_roll_pitch(make_path()[:5]), atol=0.06
    )


@pytest.mark.parametrize("shift", [-6, 5])
def test_a_wrong_clock_is_told(floor: Floor, shift: int) -> None:
    sequence = make_sequence()
    assert sequence.odometry is not None
    late = replace(sequence.odometry, timestamps_s=sequence.odometry.timestamps_s + 0.2 * shift)
    start = check(replace(sequence, odometry=late), floor)
    assert {found.code for found in start.sensors.diagnostics} & {"time-offset", "odometry-image-conflict"}
    assert start.unreliable.all()


def test_shift_is_found_to_the_frame() -> None:
    path = make_path()
    levels = DepthAttitude(depth_roll_pitch(path), np.tile([0.01, 0.003, 0.003], (COUNT, 1)))
    assert estimate_time_offset(path, levels, NOISE) is None
    late = np.concatenate([np.repeat(path[:1], 5, axis=0), path[:-5]])
    found = estimate_time_offset(late, levels, NOISE)
    assert found is not None and abs(found - 5) <= 1


def test_few_frames_or_readings_say_nothing() -> None:
    for count in (1, 2, 5):
        path = make_path()[:count]
        for levels in (
            DepthAttitude(np.zeros((0, 3)), np.zeros((0, 3))),
            DepthAttitude(np.zeros((count, 3)), np.ones((count, 3))),
        ):
            assert not compare_odometry_attitude(path, levels, NOISE).contradicts.any()
            assert estimate_time_offset(path, levels, NOISE) is None
            assert np.isfinite(align_initial_attitude(path, levels, NOISE, np.ones(3, dtype=bool))[0]).all()
    assert planar_inliers([], np.random.default_rng(0)) == []
    nothing = Navigation(np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1))
    sequence = replace(make_sequence(), navigation=nothing)
    start = initialise_from_odometry(read_navigation(sequence, BackendConfig()), sequence)
    assert start is not None
    checked = verify_odometry(start, sequence, [], Config(), np.random.default_rng(0))
    assert not checked.unreliable.any()


def make_keypoints(seed: int) -> Keypoints:
    rng = np.random.default_rng(seed)
    place = rng.uniform(1, 5, (20, 2))
    return Keypoints(
        place, place[:, 0], place[:, 1], np.ones(20), np.zeros((20, 8), np.uint8), np.zeros((0, 3, 3), np.float32)
    )


@pytest.mark.parametrize("moving", [True, False])
def test_repeated_frames_are_left_out_where_odometry_moves(moving: bool) -> None:
    keypoints = [make_keypoints(seed) for seed in (0, 1, 1, 1, 2, 3, 3, 4)]
    assert np.flatnonzero(find_duplicate_frames(keypoints)).tolist() == [2, 3, 6]
    candidates = [Matches(a, a + 1, np.zeros((0, 2), np.int64), np.zeros(0)) for a in range(7)]
    poses = make_path()[:8] if moving else np.tile(np.eye(4), (8, 1, 1))
    sequence = replace(
        make_sequence(), timestamps_s=np.arange(8.0), odometry=Trajectory(np.arange(8.0), poses), navigation=None
    )
    odometry = read_navigation(sequence, BackendConfig()).odometry
    kept, diagnostics = drop_duplicate_frames(keypoints, candidates, odometry)
    if moving:
        assert [match.frame_a for match in kept] == [0, 4]
        (found,) = diagnostics
        assert found.code == "duplicate-frames" and found.frames == ((2, 3), (6, 6))
        assert "3 of 8 frames (2-3, 6)" in found.message
    else:
        assert kept == candidates and diagnostics == ()
    assert drop_duplicate_frames(keypoints, candidates, None) == (candidates, ())
