"""Initial poses: faulty odometry is found by images or navigation, named and corrected; planar odometry otherwise."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.initialisation.initial_poses import (
    UNKNOWN_PRIOR_SIGMA,
    InitialPoses,
    initialise_from_odometry,
    initialise_from_tracks,
    replace_unreliable_steps,
    search_from_tracks,
    verify_odometry,
)
from asfm.config import BackendConfig, Config
from asfm.geometry.poses import chain_steps, depth_roll_pitch, invert, make_pose, transform
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.odometry_hypotheses import PointPairs, to_marine_axes
from asfm.navigation.sensor_constraints import UNRELIABLE_SIGMA_FACTOR, level_pose
from asfm.sequence import Sequence
from asfm.types import FloatArray, Navigation, SensorNoise, Tracks
from tests.worlds import (
    NO_TRACKS,
    VEHICLE_FRAMES,
    make_vehicle_path,
    make_vehicle_sequence,
    mirror_angle,
    mirror_axis,
    observe_floor,
    pair_points,
)


class Floor(NamedTuple):
    """What the sonar observes, independent of the odometry."""

    tracks: Tracks
    pairs: list[PointPairs]


@pytest.fixture(scope="module")
def floor() -> Floor:
    tracks = observe_floor()
    return Floor(tracks, pair_points(tracks)[::3])


def with_odometry(sequence: Sequence, change: Callable[[FloatArray], FloatArray]) -> Sequence:
    assert sequence.odometry is not None
    poses = change(sequence.odometry.world_from_vehicle)
    return replace(sequence, odometry=replace(sequence.odometry, world_from_vehicle=poses))


def initialise(sequence: Sequence, floor: Floor) -> InitialPoses:
    initial = initialise_from_odometry(read_navigation(sequence, BackendConfig()), sequence)
    assert initial is not None
    initial = verify_odometry(initial, sequence, floor.pairs, Config(), np.random.default_rng(0))
    if initial.unreliable.any():
        initial = replace_unreliable_steps(initial, sequence, floor.tracks, np.random.default_rng(0))
    for values in (
        initial.world_from_vehicle,
        initial.sensors.steps,
        initial.sensors.step_sigma,
        initial.sensors.z_roll_pitch,
    ):
        assert np.isfinite(values).all()
    assert initial.world_from_vehicle.shape == (VEHICLE_FRAMES, 4, 4) and (initial.sensors.step_sigma > 0).all()
    return initial


def turn_body(poses: FloatArray) -> FloatArray:
    return poses @ make_pose(np.zeros(3), Rotation.from_euler("z", -np.pi / 2))


LEFT_HANDED = np.diag([1.0, -1.0, 1.0, 1.0])


@pytest.mark.parametrize("seed", range(4))
def test_right_odometry_is_not_changed(floor: Floor, seed: int) -> None:
    sequence = make_vehicle_sequence(seed)
    initial = initialise(sequence, floor)
    assert initial.sensors.diagnostics == () and not initial.unreliable.any()
    assert sequence.odometry is not None
    np.testing.assert_allclose(initial.world_from_vehicle, sequence.odometry.world_from_vehicle, atol=1e-12)
    np.testing.assert_array_equal(initial.sensors.step_sigma, np.tile([0.005, 0.02], (VEHICLE_FRAMES - 1, 1)))


def test_odometry_with_twice_the_stated_noise_is_not_rejected(floor: Floor) -> None:
    noisy = make_vehicle_sequence(1, SensorNoise(0.04, 0.01, 0.01, 0.003, 0.003))
    assert initialise(noisy, floor).sensors.diagnostics == ()


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (mirror_axis(0), "with its x axis mirrored"),
        (mirror_axis(1), "with its y axis mirrored"),
        (mirror_angle(0), "with its heading mirrored"),
        (lambda poses: LEFT_HANDED @ poses @ LEFT_HANDED, "with port and starboard swapped"),
        (invert, "inverted"),
        (turn_body, "with its body axes (or the mounting of the sonar) turned by 90 deg about z"),
    ],
    ids=["x", "y", "heading", "left-handed", "inverted", "turned"],
)
@pytest.mark.parametrize("navigation", [True, False])
def test_odometry_in_a_wrong_frame_is_named_and_corrected(
    floor: Floor, change: Callable[[FloatArray], FloatArray], named: str, navigation: bool
) -> None:
    sequence = with_odometry(make_vehicle_sequence(), change)
    if not navigation:
        sequence = replace(sequence, navigation=None)
    initial = initialise(sequence, floor)
    assert any(named in found.message and " m " in found.message for found in initial.sensors.diagnostics)
    assert np.median(initial.sensors.step_sigma[:, 1]) > 0.03
    steps, truth = (invert(p[:-1]) @ p[1:] for p in (initial.world_from_vehicle, make_vehicle_path()))
    error_m = np.linalg.norm((steps - truth)[:, :3, 3], axis=1)
    assert np.median(error_m) < 0.06, "the initial poses follow the images, not the wrong steps"


@pytest.mark.parametrize("navigation", [True, False])
def test_everything_in_marine_axes_is_converted(floor: Floor, navigation: bool) -> None:
    sequence = with_odometry(make_vehicle_sequence(), to_marine_axes)
    assert sequence.navigation is not None
    readings = sequence.navigation
    marine = replace(readings, z_m=-readings.z_m, pitch_rad=-readings.pitch_rad)
    initial = initialise(replace(sequence, navigation=marine if navigation else None), floor)
    (found,) = initial.sensors.diagnostics
    assert found.code == "marine-axes" and "NED/FRD" in found.message and not initial.unreliable.any()
    steps, truth = (invert(p[:-1]) @ p[1:] for p in (initial.world_from_vehicle, make_vehicle_path()))
    assert np.median(np.linalg.norm((steps - truth)[:, :3, 3], axis=1)) < 0.06
    if navigation:
        np.testing.assert_allclose(initial.sensors.z_roll_pitch, depth_roll_pitch(make_vehicle_path()), atol=0.06)


@pytest.mark.parametrize("factor", [0.5, 1000.0, 1 / 0.3048])
def test_odometry_of_another_scale_is_corrected(floor: Floor, factor: float) -> None:
    scale = np.diag([factor, factor, factor, 1.0])
    sequence = with_odometry(make_vehicle_sequence(), lambda poses: scale @ poses @ np.linalg.inv(scale))
    initial = initialise(replace(sequence, navigation=None), floor)
    (found,) = initial.sensors.diagnostics
    assert found.code == "odometry-scale"
    length_m, true_m = (
        np.linalg.norm((invert(p[:-1]) @ p[1:])[:, :3, 3], axis=1).sum()
        for p in (initial.world_from_vehicle, make_vehicle_path())
    )
    assert 0.8 < length_m / true_m < 1.3


def test_mirrored_height_is_found_by_navigation_and_resolved_by_the_images(floor: Floor) -> None:
    initial = initialise(with_odometry(make_vehicle_sequence(), mirror_axis(2)), floor)
    message = next(found.message for found in initial.sensors.diagnostics if found.code == "sensor-conflict")
    assert "depth" in message and "one is mirrored" in message
    change, truth = (np.diff(poses[::8, 2, 3]) for poses in (initial.world_from_vehicle, make_vehicle_path()))
    held = np.isfinite(initial.sensors.z_roll_pitch_sigma[:, 0]).all()
    assert held and (initial.unreliable.all() or np.corrcoef(change, truth)[0, 1] > 0.9)


@pytest.mark.parametrize("column", ["z_m", "roll_rad"])
def test_mirrored_navigation_is_left_out(floor: Floor, column: str) -> None:
    sequence = make_vehicle_sequence()
    assert sequence.navigation is not None
    wrong = replace(sequence.navigation, **{column: -getattr(sequence.navigation, column)})
    initial = initialise(replace(sequence, navigation=wrong), floor)
    (found,) = initial.sensors.diagnostics
    assert found.code == "sensor-conflict"
    assert "one is mirrored" in found.message and "left out" in found.message
    free = np.isinf(initial.sensors.z_roll_pitch_sigma).all(axis=0)
    assert free.tolist() == [column == "z_m", column == "roll_rad", False]


def test_odometry_in_another_world_frame_is_aligned_with_navigation(floor: Floor) -> None:
    sequence = make_vehicle_sequence()
    other = make_pose(np.array([0.0, 0.0, 12.0]), Rotation.from_euler("ZYX", [0.0, 0.2, -0.1]))
    initial = initialise(with_odometry(sequence, lambda poses: other @ poses), floor)
    (found,) = initial.sensors.diagnostics
    assert found.code == "odometry-frame-offset" and "of depth" in found.message
    np.testing.assert_allclose(
        depth_roll_pitch(initial.world_from_vehicle[:5]), depth_roll_pitch(make_vehicle_path()[:5]), atol=0.06
    )


@pytest.mark.parametrize("shift", [-6, 5])
def test_wrong_time_stamps_are_reported(floor: Floor, shift: int) -> None:
    sequence = make_vehicle_sequence()
    assert sequence.odometry is not None
    late = replace(sequence.odometry, timestamps_s=sequence.odometry.timestamps_s + 0.2 * shift)
    initial = initialise(replace(sequence, odometry=late), floor)
    assert {found.code for found in initial.sensors.diagnostics} & {"time-offset", "odometry-image-conflict"}
    assert initial.unreliable.all()


def test_odometry_without_images_or_enough_readings_is_not_changed() -> None:
    one_reading = Navigation(np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1))
    sequence = replace(make_vehicle_sequence(), navigation=one_reading)
    initial = initialise_from_odometry(read_navigation(sequence, BackendConfig()), sequence)
    assert initial is not None
    verified = verify_odometry(initial, sequence, [], Config(), np.random.default_rng(0))
    assert not verified.unreliable.any()
    np.testing.assert_array_equal(verified.world_from_vehicle, initial.world_from_vehicle)


def test_corrected_odometry_has_larger_sigmas_and_consistent_steps(floor: Floor) -> None:
    sequence = replace(with_odometry(make_vehicle_sequence(), mirror_axis(1)), navigation=None)
    initial = initialise(sequence, floor)
    noise = sequence.noise
    stated = [noise.odometry_rotation_rad, noise.odometry_translation_m]
    np.testing.assert_allclose(
        initial.sensors.step_sigma, np.tile(UNRELIABLE_SIGMA_FACTOR * np.array(stated), (VEHICLE_FRAMES - 1, 1))
    )
    chain = chain_steps(initial.sensors.first_pose, initial.sensors.steps)
    np.testing.assert_allclose(chain, initial.world_from_vehicle, atol=1e-9)
    assert initial.sensors.known_steps(noise).all()


def test_only_unreliable_steps_are_replaced(floor: Floor) -> None:
    sequence = replace(make_vehicle_sequence(), navigation=None)
    initial = initialise_from_odometry(read_navigation(sequence, BackendConfig()), sequence)
    assert initial is not None
    wrong = np.zeros(VEHICLE_FRAMES - 1, dtype=bool)
    wrong[[10, 11]] = True
    steps = initial.sensors.steps.copy()
    steps[wrong, :3, 3] += 2.0
    spoiled = replace(initial, world_from_vehicle=chain_steps(initial.sensors.first_pose, steps), unreliable=wrong)
    replaced = replace_unreliable_steps(spoiled, sequence, floor.tracks, np.random.default_rng(0)).world_from_vehicle
    found, truth = (invert(poses[:-1]) @ poses[1:] for poses in (replaced, make_vehicle_path()))
    np.testing.assert_allclose(found[~wrong], steps[~wrong], atol=1e-9)
    assert np.linalg.norm((found - truth)[wrong, :3, 3], axis=1).max() < 0.2
    unsupported = replace_unreliable_steps(spoiled, sequence, NO_TRACKS, np.random.default_rng(0)).world_from_vehicle
    np.testing.assert_allclose(unsupported, spoiled.world_from_vehicle, atol=1e-9)


def _shorten(frame_count: int, navigation: bool = True) -> Sequence:
    """Make a sequence of few frames without odometry."""
    sequence = make_vehicle_sequence()
    stamps_s = sequence.timestamps_s[:frame_count]
    return replace(
        sequence,
        timestamps_s=stamps_s,
        odometry=None,
        navigation=sequence.navigation if navigation else None,
        vehicle_from_sonar=np.eye(4),
    )


def _planar_tracks(poses: FloatArray) -> Tracks:
    rng = np.random.default_rng(3)
    xyz_m = np.column_stack([rng.uniform([3, -2], [8, 2], (30, 2)), np.zeros(30)])
    seen = transform(invert(poses), xyz_m[:, None])
    track, frame = np.divmod(np.arange(30 * len(poses)), len(poses))
    range_m, bearing_rad = np.linalg.norm(seen, axis=-1), np.arctan2(seen[..., 1], seen[..., 0])
    return Tracks(track, frame, range_m.ravel(), bearing_rad.ravel())


def test_planar_odometry_of_tracks_is_exact_and_the_motion_prior_has_its_step_size() -> None:
    turn = Rotation.from_rotvec(np.outer(0.03 * np.arange(5), [0.0, 0.0, 1.0]))
    truth = make_pose(np.outer(np.arange(5), [0.2, 0.0, 0.0]), turn)
    sequence = _shorten(len(truth), navigation=False)
    initial = initialise_from_tracks(
        read_navigation(sequence, BackendConfig()), sequence, _planar_tracks(truth), Config(), np.random.default_rng(0)
    )
    np.testing.assert_allclose(initial.world_from_vehicle, truth, atol=1e-6)
    np.testing.assert_allclose(initial.sensors.steps, np.tile(np.eye(4), (4, 1, 1)), atol=1e-12)
    factor = Config().backend.motion_prior_factor
    np.testing.assert_allclose(
        initial.sensors.step_sigma, np.tile([factor * 0.03 / np.sqrt(3), factor * 0.2 / np.sqrt(3)], (4, 1)), rtol=1e-6
    )


def test_without_tracks_the_initial_poses_stay_at_the_first_reading() -> None:
    for frame_count in (1, 3):
        sequence = _shorten(frame_count)
        initial = initialise_from_tracks(
            read_navigation(sequence, BackendConfig()), sequence, NO_TRACKS, Config(), np.random.default_rng(0)
        )
        level = level_pose(read_navigation(sequence, BackendConfig()).depth_attitude.z_roll_pitch[0])
        np.testing.assert_allclose(initial.world_from_vehicle, np.repeat(level[None], frame_count, axis=0), atol=1e-12)
        sigma = Config().backend.motion_prior_factor * UNKNOWN_PRIOR_SIGMA
        expected = [sigma, sigma * sequence.sonar.range_edges_m[-1]]
        np.testing.assert_allclose(initial.sensors.step_sigma, np.tile(expected, (frame_count - 1, 1)))


def _wait(poses: FloatArray, frames: int) -> FloatArray:
    return np.concatenate([np.repeat(poses[:1], frames, axis=0), poses])


def _straight(steps_m: FloatArray) -> FloatArray:
    along = np.concatenate([[0.0], np.cumsum(steps_m)])
    turn = Rotation.from_rotvec(np.outer(0.1 * along, [0.0, 0.0, 1.0]))
    return make_pose(np.outer(along, [0.7, 0.1, 0.0]), turn)


def _initialise_alone(poses: FloatArray, navigation: bool = False) -> InitialPoses:
    sequence = _shorten(len(poses), navigation)
    if not navigation:
        sequence = replace(sequence, timestamps_s=np.arange(len(poses), dtype=float))
    return initialise_from_tracks(
        read_navigation(sequence, BackendConfig()), sequence, _planar_tracks(poses), Config(), np.random.default_rng(0)
    )


def test_a_wait_before_the_motion_does_not_tighten_its_prior_and_is_held() -> None:
    moving = _straight(np.full(12, 0.05))
    alone, after_wait = _initialise_alone(moving), _initialise_alone(_wait(moving, 40))
    np.testing.assert_allclose(after_wait.sensors.step_sigma[40:], alone.sensors.step_sigma, rtol=1e-6)
    assert after_wait.sensors.standstill is not None
    np.testing.assert_array_equal(after_wait.sensors.standstill, np.arange(52) < 40)
    assert (after_wait.sensors.step_sigma[:40] < 0.2 * alone.sensors.step_sigma[0]).all()
    np.testing.assert_allclose(after_wait.world_from_vehicle[:41], np.tile(np.eye(4), (41, 1, 1)), atol=1e-12)
    assert not after_wait.sensors.diagnostics, "a vehicle may wait"


def test_a_recording_without_motion_says_so_unless_a_sensor_measures_it() -> None:
    still = np.repeat(np.eye(4)[None], 30, axis=0)
    assert [found.code for found in _initialise_alone(still).sensors.diagnostics] == ["no-motion-seen"]
    measured = _initialise_alone(still[:VEHICLE_FRAMES], navigation=True)
    assert measured.sensors.standstill is None or not measured.sensors.standstill.any()
    assert "no-motion-seen" not in [found.code for found in measured.sensors.diagnostics]


def test_a_manoeuvre_after_slow_motion_has_a_prior_of_its_size() -> None:
    speed = np.concatenate([np.full(60, 0.01), np.full(11, 0.2), np.full(60, 0.01)])
    sigma_m = _initialise_alone(_straight(speed)).sensors.step_sigma[:, 1] / Config().backend.motion_prior_factor
    assert sigma_m[65] == pytest.approx(0.2 * np.sqrt(0.5 / 3), rel=0.02)
    overall = np.sqrt(np.mean(speed**2) * 0.5 / 3)
    assert sigma_m.min() == pytest.approx(overall, rel=0.02), "slow motion keeps the size over all steps"


def test_search_leaves_a_recording_without_motion_alone() -> None:
    still = np.repeat(np.eye(4)[None], 30, axis=0)
    initial, sequence = _initialise_alone(still), _shorten(30, navigation=False)
    found = search_from_tracks(initial, sequence, _planar_tracks(still), Config(), np.random.default_rng(0))
    assert found is initial
