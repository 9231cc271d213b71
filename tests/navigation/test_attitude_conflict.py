"""Conflicts of odometry with depth and attitude: the images decide, and without them navigation is left out."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.geometry.poses import chain_steps, depth_roll_pitch, heading
from asfm.geometry.sonar import SonarModel
from asfm.navigation.attitude_conflict import recompute_steps, resolve_attitude_conflict
from asfm.navigation.odometry_check import MIN_FRAME_PAIRS
from asfm.navigation.odometry_hypotheses import PointPairs, planar_inliers
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.types import FloatArray
from tests.worlds import (
    VEHICLE_FRAMES,
    VEHICLE_LEVER_ARM,
    VEHICLE_NOISE,
    make_constraints,
    make_vehicle_path,
    make_vehicle_sequence,
    mirror_angle,
    observe_floor,
    pair_points,
)

SEQUENCE = make_vehicle_sequence()
STEP_SIGMA = np.tile([0.005, 0.02], (VEHICLE_FRAMES - 1, 1))


@pytest.fixture(scope="module")
def pairs() -> list[PointPairs]:
    return planar_inliers(pair_points(observe_floor()), np.random.default_rng(0))


def constrain(poses: FloatArray, channel: int | None = None) -> SensorConstraints:
    """Make the constraints of exact depth and attitude, one channel mirrored."""
    sensors = make_constraints(SEQUENCE, poses, STEP_SIGMA, measured=True)
    readings = depth_roll_pitch(make_vehicle_path())
    if channel is not None:
        readings[:, channel] *= -1
    return replace(sensors, z_roll_pitch=readings)


def test_without_a_conflict_nothing_changes(pairs: list[PointPairs]) -> None:
    path = make_vehicle_path()
    sensors = constrain(path)
    poses, found = resolve_attitude_conflict(path, sensors, pairs, SEQUENCE)
    assert poses is path and found is sensors


@pytest.mark.parametrize("channel", range(3))
@pytest.mark.parametrize("images", [True, False])
def test_wrong_navigation_is_left_out_in_its_channel(pairs: list[PointPairs], channel: int, images: bool) -> None:
    path = make_vehicle_path()
    sensors = constrain(path, channel)
    poses, found = resolve_attitude_conflict(path, sensors, pairs if images else [], SEQUENCE)
    assert poses is path and [item.code for item in found.diagnostics] == ["sensor-conflict"]
    np.testing.assert_array_equal(np.isinf(found.z_roll_pitch_sigma).all(axis=0), np.arange(3) == channel)
    np.testing.assert_array_equal(np.isinf(found.z_roll_pitch_sigma).any(axis=0), np.arange(3) == channel)
    np.testing.assert_array_equal(found.steps, sensors.steps)


def test_wrong_odometry_takes_the_roll_of_navigation_where_the_images_agree(pairs: list[PointPairs]) -> None:
    path = make_vehicle_path()
    wrong = mirror_angle(2)(path)
    poses, found = resolve_attitude_conflict(wrong, constrain(wrong), pairs, SEQUENCE)
    (conflict,) = found.diagnostics
    assert conflict.code == "sensor-conflict" and "the images agree with navigation" in conflict.message
    np.testing.assert_allclose(poses, path, atol=1e-9)
    np.testing.assert_allclose(chain_steps(found.first_pose, found.steps), poses, atol=1e-9)
    assert np.isfinite(found.z_roll_pitch_sigma).all()
    for few in ([], pairs[: MIN_FRAME_PAIRS - 1]):
        blind, found = resolve_attitude_conflict(wrong, constrain(wrong), few, SEQUENCE)
        assert blind is wrong and np.isinf(found.z_roll_pitch_sigma[:, 1]).all()


def test_only_the_channels_in_conflict_take_the_values_of_navigation(pairs: list[PointPairs]) -> None:
    """Heights that differ within their noise stay those of the odometry."""
    wrong = mirror_angle(2)(make_vehicle_path())
    sensors = constrain(wrong)
    higher = replace(sensors, z_roll_pitch=sensors.z_roll_pitch + np.array([0.01, 0.0, 0.0]))
    poses, _ = resolve_attitude_conflict(wrong, higher, pairs, SEQUENCE)
    np.testing.assert_allclose(poses[:, :3, 3], wrong[:, :3, 3], atol=1e-9)
    np.testing.assert_allclose(depth_roll_pitch(poses)[:, 1], depth_roll_pitch(make_vehicle_path())[:, 1], atol=1e-9)


@pytest.mark.parametrize(("ratio", "adopted"), [(0.85, True), (0.95, False), (1.2, False)])
def test_the_images_must_be_clearly_nearer_to_navigation(
    pairs: list[PointPairs], monkeypatch: pytest.MonkeyPatch, ratio: float, adopted: bool
) -> None:
    """The distances are those under the poses of the sonar, not of the vehicle."""
    wrong = mirror_angle(2)(make_vehicle_path())

    def distance_m(_pair: PointPairs, world_from_sonar: FloatArray, _sonar: SonarModel) -> float:
        as_recorded, corrected = (
            np.allclose(world_from_sonar, poses @ VEHICLE_LEVER_ARM) for poses in (wrong, make_vehicle_path())
        )
        assert as_recorded != corrected
        return 0.2 if as_recorded else 0.2 * ratio

    monkeypatch.setattr("asfm.navigation.attitude_conflict.median_arc_distance_m", distance_m)
    poses, _ = resolve_attitude_conflict(wrong, constrain(wrong), pairs, SEQUENCE)
    assert (poses is not wrong) == adopted


def test_recomputed_steps_have_the_noise_of_both_sensors() -> None:
    path = make_vehicle_path()
    found = recompute_steps(constrain(path), path, VEHICLE_NOISE, ())
    added = [VEHICLE_NOISE.navigation_roll_rad, VEHICLE_NOISE.navigation_z_m]
    np.testing.assert_allclose(found.step_sigma**2, STEP_SIGMA**2 + 2 * np.square(added))
    np.testing.assert_allclose(chain_steps(path[0], found.steps), path, atol=1e-9)
    np.testing.assert_allclose(heading(chain_steps(path[0], found.steps)), heading(path), atol=1e-9)
