"""View change: rotation about the vertical, distance, and the bins."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.evaluation.view_change import (
    ViewChange,
    distance_bins,
    find_distance_bin,
    find_rotation_bin,
    measure_view_change,
    rotation_bins,
)
from asfm.geometry.poses import make_pose


@pytest.mark.parametrize("yaw_deg", [0.0, 3.0, -40.0, 170.0])
def test_rotation_about_the_vertical_is_the_turn_of_an_upright_or_tilted_sonar(yaw_deg: float) -> None:
    tilted = make_pose(np.array([1.0, 2, 3]), Rotation.from_euler("zyx", [50, 25, -8], degrees=True))
    turn = Rotation.from_euler("z", yaw_deg, degrees=True)
    turned = make_pose(np.zeros(3), turn) @ tilted
    turned[:3, 3] = tilted[:3, 3] + [0.3, 0, -0.4]
    change = measure_view_change(tilted, turned)
    assert change.rotation_deg == pytest.approx(abs(yaw_deg), abs=1e-9)
    assert change.distance_m == pytest.approx(0.5)
    assert measure_view_change(turned, tilted).rotation_deg == pytest.approx(abs(yaw_deg), abs=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_rotation_about_the_vertical_is_the_twist_of_the_quaternion(seed: int) -> None:
    first, second = Rotation.random(2, np.random.default_rng(seed))
    _, _, z, w = (second * first.inv()).as_quat()
    twist_deg = np.degrees(2 * np.arctan2(z, w))
    expected = abs((twist_deg + 180) % 360 - 180)
    found = measure_view_change(make_pose(np.zeros(3), first), make_pose(np.zeros(3), second))
    assert found.rotation_deg == pytest.approx(expected, abs=1e-6)


def test_pitch_and_roll_alone_are_no_rotation_about_the_vertical() -> None:
    pitched = make_pose(np.zeros(3), Rotation.from_euler("y", 12, degrees=True))
    assert measure_view_change(np.eye(4), pitched).rotation_deg == pytest.approx(0)


@pytest.mark.parametrize(
    ("rotation_deg", "distance_m", "rotation", "distance"),
    [
        (0.0, 0.0, "rotation_0_to_1_deg", "distance_0_to_2_cm"),
        (0.999, 0.0199, "rotation_0_to_1_deg", "distance_0_to_2_cm"),
        (2.0, 0.5, "rotation_2_to_5_deg", "distance_50_to_100_cm"),
        (180.0, 90.0, "rotation_45_and_more_deg", "distance_200_and_more_cm"),
    ],
)
def test_bins_hold_their_lower_edge(rotation_deg: float, distance_m: float, rotation: str, distance: str) -> None:
    change = ViewChange(rotation_deg, distance_m)
    assert (find_rotation_bin(change).key, find_distance_bin(change).key) == (rotation, distance)


def test_bins_are_named_apart() -> None:
    bins = [*rotation_bins(), *distance_bins()]
    assert len({each.key for each in bins}) == len({each.name for each in bins}) == len(bins)
