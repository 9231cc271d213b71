"""Order of images: shuffled frames and names sorted as text are found, those of a sonar that turns back are not."""

from collections.abc import Iterable

import numpy as np
import pytest

from asfm.navigation.image_order import MIN_FRAMES, diagnose_image_order, find_misplaced_frames
from asfm.types import FloatArray, IntArray, Keypoints, Matches
from tests.worlds import make_keypoints as make_frame

SIGMA = np.array([0.01, 0.002])
FEATURES = 40
GAPS = (1, 2, 3, 4)


def make_keypoints(position_m: FloatArray, seed: int = 0) -> list[Keypoints]:
    """Make keypoints of features that all frames see, from sonars at (N,) positions along the range axis."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(4, 6, FEATURES), rng.uniform(-1, 1, FEATURES)
    found = []
    for along in position_m:
        range_m = np.hypot(x - along, y) + SIGMA[0] * 0.5 * rng.normal(size=FEATURES)
        bearing_rad = np.arctan2(y, x - along) + SIGMA[1] * 0.5 * rng.normal(size=FEATURES)
        found.append(make_frame(range_m, bearing_rad))
    return found


def make_matches(position_m: FloatArray, reach_m: float, gaps: Iterable[int] = GAPS) -> list[Matches]:
    """Match all features of frames that lie within reach, and none of others."""
    same: IntArray = np.tile(np.arange(FEATURES)[:, None], (1, 2))
    return [
        Matches(first, first + gap, same[:count], np.zeros(count))
        for first in range(len(position_m))
        for gap in gaps
        if first + gap < len(position_m)
        for count in [FEATURES if abs(position_m[first + gap] - position_m[first]) <= reach_m else 0]
    ]


def find(position_m: FloatArray, reach_m: float = 0.3, gaps: Iterable[int] = GAPS) -> list[int]:
    keypoints = make_keypoints(position_m)
    return np.flatnonzero(find_misplaced_frames(keypoints, make_matches(position_m, reach_m, gaps), SIGMA)).tolist()


STEADY = 0.05 * np.arange(40, dtype=np.float64)


@pytest.mark.parametrize("reach_m", [0.3, 10.0], ids=["few match", "all match"])
def test_shuffled_images_are_found(reach_m: float) -> None:
    assert len(find(np.random.default_rng(1).permutation(STEADY), reach_m)) > MIN_FRAMES


def test_images_sorted_as_text_are_found_where_the_numbers_leap() -> None:
    order = sorted(range(40), key=str)
    assert find(STEADY[order]) == [order.index(19), order.index(29)]


@pytest.mark.parametrize(
    "position_m",
    [STEADY, STEADY[::-1], np.sin(np.arange(60) / 5), np.zeros(40), 0.05 * np.abs(np.arange(40.0) - 20)],
    ids=["steady", "backward", "to and fro", "at rest", "turns back"],
)
def test_images_in_order_are_not_reported(position_m: FloatArray) -> None:
    for seed in range(5):
        keypoints = make_keypoints(position_m, seed)
        assert not find_misplaced_frames(keypoints, make_matches(position_m, 0.3), SIGMA).any()


def test_a_single_leap_may_be_chance() -> None:
    order = sorted(range(25), key=str)
    assert find(STEADY[order]) == []


def test_matches_that_leave_out_the_next_frame_tell_nothing() -> None:
    assert find(np.random.default_rng(1).permutation(STEADY), gaps=(2, 3)) == []


def test_frames_without_features_or_matches_are_in_no_order() -> None:
    nothing = [make_frame(np.zeros(0), np.zeros(0))] * 6
    none = [Matches(a, a + gap, np.zeros((0, 2), dtype=np.int64), np.zeros(0)) for a in range(3) for gap in (1, 2, 3)]
    assert not find_misplaced_frames(nothing, none, SIGMA).any()
    assert len(find_misplaced_frames([], [], SIGMA)) == 0


def test_the_diagnostic_names_the_frames() -> None:
    assert diagnose_image_order(np.zeros(5, dtype=bool)) == ()
    (found,) = diagnose_image_order(np.array([False, True, True, False, True, False]))
    assert found.code == "image-order" and found.frames == ((1, 2), (4, 4))
    assert "3 of 6 images (1-2, 4)" in found.message and "sorted as text?" in found.message
