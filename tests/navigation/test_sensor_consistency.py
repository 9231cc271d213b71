"""Consistency of odometry with depth and attitude: conflicts, mirrored signs, time offset and initial attitude."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import depth_roll_pitch, heading, invert, make_pose
from asfm.navigation.depth_attitude import DepthAttitude, stack_readings
from asfm.navigation.sensor_consistency import (
    CONFLICT_SIGMAS,
    LAG_FRAMES,
    MIN_CHANGES,
    SensorConsistency,
    align_initial_attitude,
    compare_odometry_attitude,
    describe_conflicts,
    estimate_time_offset,
)
from asfm.types import FloatArray
from tests.worlds import VEHICLE_FRAMES, VEHICLE_NOISE, make_vehicle_path, make_vehicle_sequence

EVERY = np.ones(3, dtype=bool)
SIGMA = np.array([0.01, 0.003, 0.003])


def read_exactly(poses: FloatArray) -> DepthAttitude:
    return DepthAttitude(depth_roll_pitch(poses), np.tile(SIGMA, (len(poses), 1)))


def compare(poses: FloatArray, readings: DepthAttitude) -> SensorConsistency:
    return compare_odometry_attitude(poses, readings, VEHICLE_NOISE)


def test_noise_as_stated_is_consistent_and_of_the_expected_size() -> None:
    ratios = []
    for seed in range(30):
        sequence = make_vehicle_sequence(seed)
        assert sequence.odometry is not None and sequence.navigation is not None
        readings = DepthAttitude(stack_readings(sequence.navigation), np.tile(SIGMA, (VEHICLE_FRAMES, 1)))
        found = compare(sequence.odometry.world_from_vehicle, readings)
        assert not found.contradicts.any() and not found.mirrored.any()
        ratios.append(found.difference / found.expected)
    np.testing.assert_allclose(np.median(ratios, axis=0), 1.0, atol=0.35)


@pytest.mark.parametrize("channel", range(3))
def test_mirrored_channel_is_a_conflict_with_opposite_sign(channel: int) -> None:
    path = make_vehicle_path()
    readings = read_exactly(path)
    sign = np.where(np.arange(3) == channel, -1, 1)
    found = compare(path, replace(readings, z_roll_pitch=readings.z_roll_pitch * sign))
    assert np.flatnonzero(found.contradicts).tolist() == np.flatnonzero(found.mirrored).tolist() == [channel]
    (sentence,) = describe_conflicts(found)
    assert ("depth", "roll", "pitch")[channel] in sentence and "one is mirrored" in sentence


def test_scaled_channel_is_a_conflict_without_opposite_sign() -> None:
    path = make_vehicle_path()
    readings = read_exactly(path)
    found = compare(path, replace(readings, z_roll_pitch=readings.z_roll_pitch * [3, 1, 1]))
    assert found.contradicts.tolist() == [True, False, False] and not found.mirrored.any()
    (sentence,) = describe_conflicts(found)
    assert "mirrored" not in sentence
    assert f"{found.difference[0]:.2g} m in the median, where {found.expected[0]:.2g} m" in sentence


def test_conflicts_do_not_depend_on_the_world_frame() -> None:
    """A turn about the vertical and a shift change neither height nor attitude changes."""
    path = make_vehicle_path()
    other = make_pose(np.array([3.0, -8.0, 5.0]), Rotation.from_euler("z", 2.0))
    here, there = (compare(poses, read_exactly(path)) for poses in (path, other @ path))
    np.testing.assert_allclose(there.difference, here.difference, atol=1e-9)


def test_roll_across_half_a_turn_is_no_conflict() -> None:
    path = make_vehicle_path() @ make_pose(np.zeros(3), Rotation.from_euler("x", np.pi))
    readings = read_exactly(path)
    wrapped = readings.z_roll_pitch.copy()
    wrapped[:, 1] = np.angle(np.exp(1j * wrapped[:, 1]))
    assert np.ptp(wrapped[:, 1]) > 6, "the readings jump by a whole turn"
    assert not compare(path, replace(readings, z_roll_pitch=wrapped)).contradicts.any()


@pytest.mark.parametrize("shift", [-7, -2, 5])
def test_time_offset_is_found_to_the_frame(shift: int) -> None:
    path = make_vehicle_path()
    readings = read_exactly(path)
    assert estimate_time_offset(path, readings, VEHICLE_NOISE) is None
    late = path[np.clip(np.arange(VEHICLE_FRAMES) - shift, 0, VEHICLE_FRAMES - 1)]
    found = estimate_time_offset(late, readings, VEHICLE_NOISE)
    assert found is not None and abs(found - shift) <= 1


def test_mirrored_roll_is_no_time_offset() -> None:
    path = make_vehicle_path()
    readings = read_exactly(path)
    mirrored = replace(readings, z_roll_pitch=readings.z_roll_pitch * [1, -1, 1])
    assert estimate_time_offset(path, mirrored, VEHICLE_NOISE) is None


def test_a_mirrored_roll_that_half_a_period_explains_too_is_no_time_offset() -> None:
    """A sine of a period of 14 frames is its own mirror image seven frames later."""
    roll_rad = 0.2 * np.sin(2 * np.pi * np.arange(VEHICLE_FRAMES) / 14)
    poses = make_pose(np.zeros((VEHICLE_FRAMES, 3)), Rotation.from_rotvec(np.outer(roll_rad, [1.0, 0.0, 0.0])))
    readings = read_exactly(poses)
    mirrored = replace(readings, z_roll_pitch=readings.z_roll_pitch * [1, -1, 1])
    assert compare(poses[7:], read_exactly(poses[:-7])).mirrored[1]
    assert estimate_time_offset(poses, mirrored, VEHICLE_NOISE) is None


def test_initial_depth_and_attitude_are_aligned_and_position_heading_and_steps_kept() -> None:
    path = make_vehicle_path()
    other = make_pose(np.array([0.0, 0.0, 12.0]), Rotation.from_euler("ZYX", [0.0, 0.2, -0.1])) @ path
    aligned, diagnostics = align_initial_attitude(other, read_exactly(path), VEHICLE_NOISE, EVERY)
    assert [found.code for found in diagnostics] == ["odometry-frame-offset"]
    np.testing.assert_allclose(depth_roll_pitch(aligned[:5]), depth_roll_pitch(path[:5]), atol=0.06)
    np.testing.assert_allclose(aligned[0, :2, 3], other[0, :2, 3])
    np.testing.assert_allclose(heading(aligned[0]), heading(other[0]))
    np.testing.assert_allclose(invert(aligned[:-1]) @ aligned[1:], invert(other[:-1]) @ other[1:], atol=1e-12)


def test_untrusted_channels_and_small_offsets_are_left() -> None:
    path = make_vehicle_path()
    lower = path.copy()
    lower[:, 2, 3] -= 3.0
    kept, diagnostics = align_initial_attitude(lower, read_exactly(path), VEHICLE_NOISE, ~EVERY)
    assert kept is lower and diagnostics == ()
    near = path.copy()
    near[:, 2, 3] += 0.05
    kept, diagnostics = align_initial_attitude(near, read_exactly(path), VEHICLE_NOISE, EVERY)
    assert kept is near and diagnostics == ()


def test_first_readings_that_come_late_align_nothing() -> None:
    path = make_vehicle_path()
    lower = path.copy()
    lower[:, 2, 3] -= 3.0
    readings = read_exactly(path)
    readings.sigma[:10] = np.inf
    assert align_initial_attitude(lower, readings, VEHICLE_NOISE, EVERY)[0] is lower


@pytest.mark.parametrize("count", [1, 2, 5, MIN_CHANGES])
@pytest.mark.parametrize("measured", [True, False])
def test_few_frames_or_readings_are_not_tested(count: int, measured: bool) -> None:
    path = make_vehicle_path()[:count]
    readings = DepthAttitude(np.zeros((count, 3)), np.ones((count, 3)))
    if not measured:
        readings = DepthAttitude(np.zeros((0, 3)), np.zeros((0, 3)))
    found = compare(path, readings)
    assert not found.contradicts.any() and (CONFLICT_SIGMAS * found.expected > 0).all()
    assert estimate_time_offset(path, readings, VEHICLE_NOISE) is None
    aligned, _ = align_initial_attitude(path, readings, VEHICLE_NOISE, EVERY)
    assert np.isfinite(aligned).all() and measured != (aligned is path)


@pytest.mark.parametrize("sign", [-1, 1])
def test_unrelated_readings_are_not_mirrored(sign: int) -> None:
    """They agree with either sign about as badly."""
    path = make_vehicle_path()
    readings = read_exactly(path)
    noise = np.random.default_rng(0).normal(size=VEHICLE_FRAMES) * np.std(readings.z_roll_pitch[:, 1])
    spoiled = np.stack([readings.z_roll_pitch[:, 0], sign * noise, readings.z_roll_pitch[:, 2]], axis=1)
    found = compare(path, replace(readings, z_roll_pitch=spoiled))
    assert found.contradicts.tolist() == [False, True, False] and not found.mirrored.any()


def test_a_scaled_roll_is_no_time_offset() -> None:
    path = make_vehicle_path()
    readings = read_exactly(path)
    scaled = replace(readings, z_roll_pitch=readings.z_roll_pitch * [1, 3, 1])
    assert compare(path, scaled).contradicts[1]
    assert estimate_time_offset(path, scaled, VEHICLE_NOISE) is None


def test_a_roll_that_differs_by_whole_turns_is_not_aligned() -> None:
    path = make_vehicle_path()
    readings = read_exactly(path)
    turned = replace(readings, z_roll_pitch=readings.z_roll_pitch + np.array([0.0, 2 * np.pi, -2 * np.pi]))
    assert align_initial_attitude(path, turned, VEHICLE_NOISE, EVERY)[0] is path


@pytest.mark.parametrize("speed_m", [0.0, 5.0])
def test_expected_change_of_height_grows_with_the_path(speed_m: float) -> None:
    """An attitude error of some steps tilts the path: at 5 m a frame that outweighs all else."""
    poses = np.tile(np.eye(4), (VEHICLE_FRAMES, 1, 1))
    poses[:, 0, 3] = speed_m * np.arange(VEHICLE_FRAMES)
    expected_m = compare(poses, read_exactly(poses)).expected[0]
    turn_rad, noise = VEHICLE_NOISE.odometry_rotation_rad * np.sqrt(LAG_FRAMES), VEHICLE_NOISE
    variance = 2 * noise.navigation_z_m**2 + LAG_FRAMES * noise.odometry_translation_m**2
    assert expected_m == pytest.approx(np.sqrt(variance + (turn_rad * speed_m * LAG_FRAMES) ** 2))


def test_changes_since_frames_that_were_not_measured_are_not_compared() -> None:
    """Readings alternate between measured and not over the lag, so that every change has one wrong end."""
    path = make_vehicle_path()
    readings, measured = read_exactly(path), np.arange(VEHICLE_FRAMES) // LAG_FRAMES % 2 == 0
    spoiled = DepthAttitude(readings.z_roll_pitch + 5.0 * ~measured[:, None], readings.sigma.copy())
    spoiled.sigma[~measured] = np.inf
    found = compare(path, spoiled)
    assert not found.difference.any() and not found.contradicts.any()
