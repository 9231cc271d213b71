"""Image jumps: exchanged and lost frames are found; right, empty and long unmatched ones are not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import chain_steps, make_pose, steps_between
from asfm.navigation.image_jumps import diagnose_image_jumps, find_image_jumps
from asfm.navigation.odometry_hypotheses import PointPairs
from asfm.types import BoolArray, FloatArray
from tests.worlds import (
    VEHICLE_FRAMES,
    VEHICLE_LEVER_ARM,
    VEHICLE_SONAR,
    make_vehicle_sequence,
    observe_floor,
    pair_points,
)

PLENTY = np.full(VEHICLE_FRAMES, 40)


@pytest.fixture(scope="module")
def pairs() -> list[PointPairs]:
    return pair_points(observe_floor())


def odometry(seed: int = 0) -> FloatArray:
    recorded = make_vehicle_sequence(seed).odometry
    assert recorded is not None
    return recorded.world_from_vehicle


def find(poses: FloatArray, pairs: list[PointPairs], counts: FloatArray = PLENTY) -> BoolArray:
    sigma = np.tile([0.005, 0.02], (VEHICLE_FRAMES - 1, 1))
    features = np.array([0.015, 0.005])
    return find_image_jumps(poses @ VEHICLE_LEVER_ARM, sigma, pairs, counts.astype(int), VEHICLE_SONAR, features)


def without(pairs: list[PointPairs], step: int, spared: tuple[int, int] = (0, 0)) -> list[PointPairs]:
    """Leave no matches across a step, but those of one pair of frames."""
    kept = []
    for pair in pairs:
        across = pair.frame_a <= step < pair.frame_b and (pair.frame_a, pair.frame_b) != spared
        nothing = np.zeros((0, 2))
        kept.append(replace(pair, range_bearing_a=nothing, range_bearing_b=nothing) if across else pair)
    return kept


@pytest.mark.parametrize("seed", range(4))
def test_right_images_do_not_jump(pairs: list[PointPairs], seed: int) -> None:
    assert not find(odometry(seed), pairs).any()


def test_images_without_a_common_motion_jump(pairs: list[PointPairs]) -> None:
    assert np.flatnonzero(find(odometry(), without(pairs, 17))).tolist() == [17]
    assert np.flatnonzero(find(odometry(), without(without(pairs, 17), 18))).tolist() == [17, 18]


def test_a_step_that_another_pair_bridges_is_no_jump(pairs: list[PointPairs]) -> None:
    assert not find(odometry(), without(pairs, 17, spared=(16, 18))).any()


def test_an_exchanged_frame_jumps_although_its_neighbours_match(pairs: list[PointPairs]) -> None:
    exchanged = without(without(pairs, 17, spared=(17, 19)), 18, spared=(17, 19))
    assert np.flatnonzero(find(odometry(), exchanged)).tolist() == [17, 18]


def test_images_that_go_on_farther_than_odometry_jump(pairs: list[PointPairs]) -> None:
    """Odometry that turns by 10 deg less than the images at one step."""
    poses = odometry()
    turn = make_pose(np.zeros(3), Rotation.from_euler("z", 10, degrees=True))
    steps = steps_between(poses)
    steps[20] = steps[20] @ turn
    assert np.flatnonzero(find(chain_steps(poses[0], steps), pairs)).tolist() == [20]


def test_long_unmatched_stretches_poor_images_and_the_ends_are_not_judged(pairs: list[PointPairs]) -> None:
    long = pairs
    for step in range(15, 20):
        long = without(long, step)
    assert not find(odometry(), long).any()
    poor = PLENTY.copy()
    poor[18] = 3
    assert not find(odometry(), without(pairs, 17), poor).any()
    assert not find(odometry(), without(pairs, 0)).any()
    assert not find(odometry(), []).any()


def test_jumps_are_reported_with_their_frames() -> None:
    jumps = np.zeros(30, dtype=bool)
    jumps[[4, 11, 12]] = True
    (found,) = diagnose_image_jumps(jumps)
    assert found.code == "image-jumps" and found.frames == ((4, 5), (11, 13)) and "3 of 30 steps" in found.message
    assert diagnose_image_jumps(np.zeros(5, dtype=bool)) == ()


def test_steps_at_which_odometry_jumps_too_are_no_jumps_of_the_images(pairs: list[PointPairs]) -> None:
    """The vehicle may really have moved so: images without matches are no contradiction."""
    poses = odometry()
    steps = steps_between(poses)
    steps[17, :3, 3] *= 8.0
    assert not find(chain_steps(poses[0], steps), without(pairs, 17)).any()
