"""Depth and attitude at the frame times: outliers rejected and reported, gaps unconstrained, rare readings shared."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.config import BackendConfig
from asfm.geometry.poses import depth_roll_pitch, make_pose, wrap_angle
from asfm.geometry.sonar import SonarModel
from asfm.navigation.depth_attitude import frames_per_reading, interpolate_depth_attitude
from asfm.sequence import Sequence
from asfm.simulation.vehicle.sensors import measure_tilt
from asfm.types import FloatArray, Navigation, SensorNoise, Trajectory
from tests.worlds import no_frame

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (500, 128), np.deg2rad(20))
NOISE = SensorNoise(0.02, 0.005, 0.01, 0.003, 0.003)
COUNT = 60


def make_sequence(seed: int = 0, readings_every_s: float = 0.2, offset_s: float = 0.0) -> Sequence:
    """Make frames five times a second; depth and attitude oscillate by many times their noise."""
    rng = np.random.default_rng(seed)
    stamps = np.arange(offset_s, COUNT * 0.2, readings_every_s)
    level = sway(stamps) + rng.normal(0, [0.01, 0.003, 0.003], (len(stamps), 3))
    navigation = Navigation(stamps, *level.T)
    return Sequence("simulated", SONAR, frame_stamps(), no_frame, navigation=navigation, noise=NOISE)


def frame_stamps() -> FloatArray:
    return np.asarray(0.2 * np.arange(COUNT))


def sway(stamps: FloatArray) -> FloatArray:
    return np.stack([-2 + 0.3 * np.sin(stamps), 0.2 * np.sin(1.3 * stamps), 0.15 * np.cos(stamps)], axis=1)


def spoil(sequence: Sequence, column: int, offsets: dict[int, float]) -> Sequence:
    assert sequence.navigation is not None
    names = ("z_m", "roll_rad", "pitch_rad")
    values = getattr(sequence.navigation, names[column]).copy()
    for index, offset in offsets.items():
        values[index] += offset
    return replace(sequence, navigation=replace(sequence.navigation, **{names[column]: values}))


@pytest.mark.parametrize("seed", range(3))
def test_clean_readings_are_all_used(seed: int) -> None:
    sequence = make_sequence(seed)
    readings = interpolate_depth_attitude(sequence, BackendConfig())
    assert readings.diagnostics == ()
    assert sequence.navigation is not None
    np.testing.assert_array_equal(readings.z_roll_pitch[:, 0], sequence.navigation.z_m)
    np.testing.assert_allclose(readings.sigma, np.tile([0.01, 0.003, 0.003], (COUNT, 1)))


@pytest.mark.parametrize("where", [{0: 1.0}, {59: -1.0}, {7: 1.0, 20: -1.0, 33: 1.0, 34: 1.0, 50: -0.5}])
def test_outlier_depths_are_rejected_and_reported(where: dict[int, float]) -> None:
    readings = interpolate_depth_attitude(spoil(make_sequence(), 0, where), BackendConfig())
    truth = sway(frame_stamps())
    inner = np.isfinite(readings.sigma[:, 0])
    assert inner.sum() >= COUNT - 1
    assert np.abs(readings.z_roll_pitch[inner, 0] - truth[inner, 0]).max() < 0.08
    (found,) = readings.diagnostics
    assert found.code == "navigation-outliers"
    assert (
        f"{len(where)} of 60 depth readings" in found.message
        and " m, where the stated sigma is 0.01 m" in found.message
    )


def test_outlier_attitude_does_not_affect_the_depth() -> None:
    readings = interpolate_depth_attitude(spoil(make_sequence(), 1, {30: np.deg2rad(20)}), BackendConfig())
    (found,) = readings.diagnostics
    assert found.code == "navigation-outliers"
    assert "1 of 60 roll readings" in found.message and "sigma is 0.17 deg" in found.message
    assert readings.sigma[30, 1] == pytest.approx(0.003 * np.sqrt(2)), (
        "interpolated between its neighbours, twice as far apart"
    )
    assert readings.sigma[30, 0] == pytest.approx(0.01)


def test_jump_that_odometry_confirms_is_not_rejected() -> None:
    sequence = spoil(make_sequence(), 0, {30: 1.0, 31: 1.0})
    position = np.zeros((COUNT, 3))
    position[[30, 31], 2] = 1.0
    odometry = Trajectory(sequence.timestamps_s, make_pose(position, Rotation.identity(COUNT)))
    assert interpolate_depth_attitude(sequence, BackendConfig(), odometry).diagnostics == ()
    alone = interpolate_depth_attitude(sequence, BackendConfig())
    assert [found.code for found in alone.diagnostics] == ["navigation-outliers"]


def test_frames_in_a_gap_have_no_depth() -> None:
    sequence = make_sequence()
    assert sequence.navigation is not None
    keep = np.ones(COUNT, dtype=bool)
    keep[30:41] = False
    columns = (sequence.navigation.z_m, sequence.navigation.roll_rad, sequence.navigation.pitch_rad)
    cut = Navigation(sequence.navigation.timestamps_s[keep], *(column[keep] for column in columns))
    readings = interpolate_depth_attitude(replace(sequence, navigation=cut), BackendConfig())
    np.testing.assert_array_equal(np.isfinite(readings.sigma).all(axis=1), keep)
    assert np.isfinite(readings.z_roll_pitch).all()
    (found,) = readings.diagnostics
    assert found.code == "navigation-gap" and found.frames == ((30, 40),)
    assert "11 of 60 frames (30-40)" in found.message


def test_frames_outside_the_time_of_the_readings_have_no_depth() -> None:
    readings = interpolate_depth_attitude(make_sequence(offset_s=4.0), BackendConfig())
    assert np.flatnonzero(~np.isfinite(readings.sigma[:, 0])).tolist() == [*range(20), 59][:20]
    found = readings.diagnostics[0]
    assert found.code == "navigation-gap" and "20 of 60 frames (0-19)" in found.message


def test_rare_readings_are_not_counted_more_than_once() -> None:
    """One reading a second, five frames: the information of all frames together is that of the readings."""
    readings = interpolate_depth_attitude(make_sequence(readings_every_s=1.0, offset_s=0.1), BackendConfig())
    known = np.isfinite(readings.sigma[:, 0])
    information = float(np.sum(readings.sigma[known, 0] ** -2.0)) * 0.01**2
    assert 10 < information < 16
    assert {found.code for found in readings.diagnostics} <= {"navigation-gap"}


def test_a_roll_that_passes_half_a_turn_is_interpolated_the_short_way() -> None:
    """Readings jump from pi to -pi; frames lie between them."""
    sequence = make_sequence(offset_s=0.1)
    assert sequence.navigation is not None
    stamps_s = sequence.navigation.timestamps_s
    roll_rad = 2.9 + 0.1 * (stamps_s - stamps_s[0])
    wrapped = replace(sequence.navigation, roll_rad=wrap_angle(roll_rad))
    readings = interpolate_depth_attitude(replace(sequence, navigation=wrapped), BackendConfig())
    assert readings.diagnostics == ()
    inner = (frame_stamps() > stamps_s[0]) & (frame_stamps() < stamps_s[-1])
    expected_rad = 2.9 + 0.1 * (frame_stamps() - stamps_s[0])
    np.testing.assert_allclose(wrap_angle(readings.z_roll_pitch[:, 1] - expected_rad)[inner], 0, atol=1e-9)


def test_frames_per_reading() -> None:
    frames: FloatArray = np.arange(10.0)
    np.testing.assert_array_equal(frames_per_reading(frames, frames), np.ones(10))
    np.testing.assert_array_equal(frames_per_reading(np.arange(0, 10, 0.1), frames), np.ones(10))
    assert np.isinf(frames_per_reading(np.zeros(0), frames)).all()
    one = frames_per_reading(np.array([4.0]), frames)
    assert np.flatnonzero(np.isfinite(one)).tolist() == [4]


def test_tilt_agrees_with_the_simulator() -> None:
    rng = np.random.default_rng(1)
    poses = make_pose(rng.normal(0, 1, (20, 3)), Rotation.from_euler("ZYX", rng.uniform(-1, 1, (20, 3))))
    roll_rad, pitch_rad = measure_tilt(poses)
    np.testing.assert_allclose(
        depth_roll_pitch(poses), np.stack([poses[:, 2, 3], roll_rad, pitch_rad], axis=1), atol=1e-12
    )


def test_frames_that_are_rarer_than_readings_take_one_within_half_their_own_interval() -> None:
    """Readings five times a second pause from 9.2 s to 14.2 s; frames are 2 s apart."""
    reading_s = np.concatenate([np.arange(0, 9.3, 0.2), np.arange(14.2, 20, 0.2)])
    known = np.isfinite(frames_per_reading(reading_s, np.arange(0.0, 20.0, 2.0)))
    assert np.flatnonzero(~known).tolist() == [6]


def test_readings_that_differ_from_odometry_by_its_noise_are_no_outliers() -> None:
    """A sensor of a hundredth of the odometry's noise: what is left after the odometry is its noise, not jumps."""
    sequence = make_sequence()
    exact = sway(frame_stamps())
    navigation = Navigation(frame_stamps(), *exact.T)
    precise = replace(NOISE, navigation_z_m=1e-4)
    height_m = exact[:, 0] + np.where(np.arange(COUNT) % 12 == 5, 0.06, 0.0)
    position = np.stack([np.zeros(COUNT), np.zeros(COUNT), height_m], axis=1)
    odometry = Trajectory(frame_stamps(), make_pose(position, Rotation.identity(COUNT)))
    noisy = replace(sequence, navigation=navigation, noise=precise)
    assert interpolate_depth_attitude(noisy, BackendConfig(), odometry).diagnostics == ()


def test_a_frame_at_the_time_of_a_reading_shares_it_with_no_other() -> None:
    """The readings are twice as rare as the frames, between which they are interpolated."""
    shared = frames_per_reading(np.arange(0.0, 6.0), np.arange(0.0, 5.1, 0.5))
    np.testing.assert_allclose(shared, np.where(np.arange(11) % 2 == 0, 1.0, 2.0))
