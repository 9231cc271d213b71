"""Local origin: near the path, zero near the world's own, and taken off and added back without loss."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from asfm.geometry.local_origin import GRID_M, local_origin, shift_reconstruction
from asfm.geometry.poses import make_pose
from asfm.types import Reconstruction, Trajectory
from tests.worlds import NO_TRACKS, make_landmarks

coordinates = st.floats(-6e6, 6e6)


@given(coordinates, coordinates, coordinates)
def test_origin_is_a_grid_point_near_the_path(x: float, y: float, z: float) -> None:
    path_m = np.array([x, y, z]) + np.random.default_rng(0).uniform(-50, 50, (20, 3))
    origin_m = local_origin(path_m)
    assert np.abs(np.median(path_m, axis=0) - origin_m).max() <= GRID_M / 2
    np.testing.assert_array_equal(origin_m % GRID_M, 0)


def test_origin_is_the_world_s_own_for_a_path_near_it_and_without_a_path() -> None:
    for path_m in (np.array([[-3.0, 400.0, -499.0]]), np.zeros((0, 3))):
        np.testing.assert_array_equal(local_origin(path_m), np.zeros(3))
        assert not np.signbit(local_origin(path_m)).any()


def test_zeros_before_the_first_fix_do_not_move_the_origin() -> None:
    path_m = np.tile([5e5, 5.572e6, 0.0], (9, 1))
    path_m[:3] = 0
    np.testing.assert_array_equal(local_origin(path_m), [5e5, 5.572e6, 0.0])


def test_shifting_moves_positions_points_and_arcs_alike_and_nothing_else() -> None:
    rng = np.random.default_rng(1)
    trajectory = Trajectory(np.arange(4.0), make_pose(rng.normal(size=(4, 3)), Rotation.random(4, rng)))
    whole = Reconstruction(
        trajectory, NO_TRACKS, np.zeros(0, bool), make_landmarks(3, 2), rng.normal(size=(4, 6, 6)), ()
    )
    offset_m = np.array([1000.0, -2000.0, 3000.0])
    moved = shift_reconstruction(whole, offset_m)
    before, after = trajectory.world_from_vehicle, moved.trajectory.world_from_vehicle
    np.testing.assert_allclose(after[:, :3, 3], before[:, :3, 3] + offset_m)
    np.testing.assert_array_equal(after[:, :3, :3], before[:, :3, :3])
    np.testing.assert_array_equal(moved.landmarks.xyz_m, np.tile(offset_m, (3, 1)))
    np.testing.assert_array_equal(moved.landmarks.arc_m, np.tile(offset_m, (3, 15, 1)))
    assert moved.pose_covariance is whole.pose_covariance
    assert moved.landmarks.covariance_m2 is whole.landmarks.covariance_m2
