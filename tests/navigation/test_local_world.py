"""Local world: one offset for all sensors, and only what the run takes from them."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.config import BackendConfig
from asfm.geometry.local_origin import shift_trajectory
from asfm.navigation.local_world import move_to_local_origin, with_world_of
from asfm.sequence import Sequence
from asfm.types import FloatArray
from tests.worlds import make_vehicle_sequence

UTM_M = np.array([500000.0, 5572094.155, 0.0])


def shift_world(sequence: Sequence, offset_m: FloatArray) -> Sequence:
    """Add an offset to odometry, depth and true poses."""
    odometry, navigation, truth = sequence.odometry, sequence.navigation, sequence.groundtruth
    assert odometry is not None and navigation is not None and truth is not None
    return replace(
        sequence,
        odometry=shift_trajectory(odometry, offset_m),
        navigation=replace(navigation, z_m=navigation.z_m + offset_m[2]),
        groundtruth=shift_trajectory(truth, offset_m),
    )


@pytest.mark.parametrize("offset_m", [np.zeros(3), UTM_M, np.array([-3e6, 250.0, 4321.5])])
def test_all_sensors_are_moved_by_one_offset_to_near_the_origin(offset_m: FloatArray) -> None:
    sequence = shift_world(make_vehicle_sequence(), offset_m)
    local, origin_m = move_to_local_origin(sequence, BackendConfig())
    back = shift_world(local, origin_m)
    assert local.odometry is not None and local.navigation is not None and local.groundtruth is not None
    assert back.odometry is not None and back.navigation is not None and back.groundtruth is not None
    assert sequence.odometry is not None and sequence.navigation is not None and sequence.groundtruth is not None
    assert np.abs(local.odometry.world_from_vehicle[:, :3, 3]).max() < 600
    for recorded, found in ((sequence.odometry, back.odometry), (sequence.groundtruth, back.groundtruth)):
        np.testing.assert_allclose(found.world_from_vehicle, recorded.world_from_vehicle, rtol=0, atol=2e-9)
    np.testing.assert_allclose(back.navigation.z_m, sequence.navigation.z_m, rtol=0, atol=2e-9)
    again = with_world_of(local, sequence)
    assert (again.odometry, again.navigation) == (sequence.odometry, sequence.navigation)
    assert again.groundtruth is sequence.groundtruth


@pytest.mark.parametrize(("use_odometry", "use_navigation"), [(True, False), (False, True), (False, False)])
def test_a_sensor_that_is_not_used_does_not_move_the_world(use_odometry: bool, use_navigation: bool) -> None:
    config = BackendConfig(use_odometry=use_odometry, use_navigation=use_navigation)
    _, origin_m = move_to_local_origin(shift_world(make_vehicle_sequence(), np.array([7e3, 8e3, 9e3])), config)
    assert (np.abs(origin_m[:2]) > 0).all() == use_odometry
    assert (origin_m[2] > 0) == (use_odometry or use_navigation)


def test_depths_without_odometry_are_the_same_to_the_bit_wherever_their_origin_is() -> None:
    sequence = replace(make_vehicle_sequence(), odometry=None)
    assert sequence.navigation is not None
    recorded_m = np.round(sequence.navigation.z_m, 4)
    found = []
    for offset_m in (0.0, 45.1, -1234.5678, 5.6e6):
        moved = replace(sequence, navigation=replace(sequence.navigation, z_m=recorded_m + offset_m))
        local, origin_m = move_to_local_origin(moved, BackendConfig())
        assert local.navigation is not None
        np.testing.assert_allclose(local.navigation.z_m + origin_m[2], recorded_m + offset_m, atol=1e-6)
        found.append(local.navigation.z_m)
    for depth_m in found[1:]:
        np.testing.assert_array_equal(depth_m, found[0])
