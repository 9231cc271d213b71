"""Changes of a sequence: each is what it says, and leaves everything else as it is."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.geometry.poses import depth_roll_pitch, invert
from asfm.sequence import Sequence
from asfm.types import FloatArray, Frame
from tests.worlds import make_vehicle_sequence
from tools.benchmark import sequence_changes as changes


def read_frame(index: int) -> Frame:
    image = np.full((3, 4), index, dtype=np.float32)
    image[0, 0] += 0.5
    return Frame(index, 0.2 * index, image, image < 0)


@pytest.fixture(scope="module")
def sequence() -> Sequence:
    return replace(make_vehicle_sequence(), read_frame=read_frame)


def odometry(sequence: Sequence) -> FloatArray:
    assert sequence.odometry is not None
    return sequence.odometry.world_from_vehicle


def test_the_sonar_is_stated_otherwise(sequence: Sequence) -> None:
    sonar = sequence.sonar
    np.testing.assert_allclose(changes.change_sonar(sequence, range_scale=1.2).sonar.range_m, 1.2 * sonar.range_m)
    near = changes.change_sonar(sequence, near_m=0.5).sonar.range_m - sonar.range_m
    assert near[0] == pytest.approx(0.5) and near[-1] == pytest.approx(0) and (np.diff(near) < 0).all()
    wide = changes.change_sonar(sequence, bearing_scale=1.1).sonar
    np.testing.assert_allclose(wide.bearing_rad, 1.1 * sonar.bearing_rad)
    np.testing.assert_array_equal(wide.range_m, sonar.range_m)


def test_the_mounting_is_turned_about_the_sonar(sequence: Sequence) -> None:
    turned = changes.turn_mounting(sequence, (5.0, 0.0, 0.0), np.zeros(3)).vehicle_from_sonar
    step = invert(sequence.vehicle_from_sonar) @ turned
    assert np.rad2deg(np.arctan2(step[1, 0], step[0, 0])) == pytest.approx(5.0)
    np.testing.assert_allclose(step[:3, 3], 0, atol=1e-12)


def test_odometry_is_scaled_about_its_start(sequence: Sequence) -> None:
    poses = odometry(sequence)
    scaled = changes.scale_positions(poses, 0.5)
    np.testing.assert_allclose(scaled[:, :3, 3] - poses[0, :3, 3], 0.5 * (poses[:, :3, 3] - poses[0, :3, 3]))
    np.testing.assert_array_equal(scaled[:, :3, :3], poses[:, :3, :3])


def test_marine_axes_are_their_own_inverse(sequence: Sequence) -> None:
    poses = odometry(sequence)
    marine = changes.convert_to_marine(poses)
    np.testing.assert_allclose(changes.convert_to_marine(marine), poses, atol=1e-12)
    np.testing.assert_allclose(marine[:, 2, 3], -poses[:, 2, 3])
    np.testing.assert_allclose(depth_roll_pitch(marine)[:, 2], -depth_roll_pitch(poses)[:, 2], atol=1e-9)
    np.testing.assert_allclose(depth_roll_pitch(marine)[:, 1], depth_roll_pitch(poses)[:, 1], atol=1e-9)


def test_depth_and_attitude_are_scaled_swapped_and_delayed(sequence: Sequence) -> None:
    readings = sequence.navigation
    assert readings is not None
    found = changes.scale_navigation(sequence, (-1.0, 1.0, -1.0)).navigation
    assert found is not None
    np.testing.assert_array_equal(found.z_m, -readings.z_m)
    np.testing.assert_array_equal(found.roll_rad, readings.roll_rad)
    np.testing.assert_array_equal(found.pitch_rad, -readings.pitch_rad)
    swapped = changes.scale_navigation(sequence, (1.0, 1.0, 1.0), swapped=True).navigation
    assert swapped is not None
    np.testing.assert_array_equal(swapped.roll_rad, readings.pitch_rad)
    late = changes.delay_all_sensors(sequence)
    assert late.navigation is not None and late.odometry is not None and sequence.odometry is not None
    np.testing.assert_allclose(late.navigation.timestamps_s - readings.timestamps_s, 0.5)
    np.testing.assert_allclose(late.odometry.timestamps_s - sequence.odometry.timestamps_s, 0.5)


@pytest.mark.parametrize("order", [changes.shuffle, changes.sort_as_text])
def test_other_orders_show_every_frame_once(order: changes.Order) -> None:
    numbers = order(40)
    assert sorted(numbers.tolist()) == list(range(40)) and (numbers != np.arange(40)).any()


def test_images_come_in_another_order_at_the_same_times(sequence: Sequence) -> None:
    late = changes.change_images(sequence, changes.delay_by_one)
    assert [int(late.read_frame(index).image[1, 1]) for index in (0, 1, 5)] == [0, 0, 4]
    assert late.read_frame(5).index == 5 and late.read_frame(5).timestamp_s == pytest.approx(1.0)
    mirrored = changes.change_images(sequence, turn=lambda image: image[:, ::-1]).read_frame(2)
    assert mirrored.image[0, -1] == 2.5 and mirrored.image.flags.c_contiguous and mirrored.invalid.dtype == bool


def test_a_gap_is_closed_with_its_truth(sequence: Sequence) -> None:
    closed = changes.close_gap(sequence)
    assert len(closed) == len(sequence) - 5
    assert [int(closed.read_frame(index).image[1, 1]) for index in (19, 20)] == [19, 25]
    assert closed.groundtruth is not None and sequence.groundtruth is not None
    np.testing.assert_array_equal(
        closed.groundtruth.world_from_vehicle[20], sequence.groundtruth.world_from_vehicle[25]
    )
