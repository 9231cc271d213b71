"""Selection of frames: numbers, stamps, images, truth and matches of a part are those of the whole."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.config import FramesConfig
from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError
from asfm.frame_selection import choose_frames, take_frames, take_matches, take_truth
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import ExternalMatches, Frame, FrameTruth, Matches
from tests.worlds import make_keypoints

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (4, 3), 0.3)


def read_frame(index: int) -> Frame:
    return Frame(index, 0.5 * index, np.full((4, 3), index / 20, dtype=np.float32), np.zeros((4, 3), dtype=bool))


WHOLE = Sequence("whole", SONAR, 0.5 * np.arange(20, dtype=np.float64), read_frame)


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({}, list(range(20))),
        ({"first": 5}, list(range(5, 20))),
        ({"last": 3}, [0, 1, 2, 3]),
        ({"first": 4, "last": 12, "every": 3}, [4, 7, 10]),
        ({"first": 19, "last": 19}, [19]),
        ({"every": 100}, [0]),
    ],
)
def test_frames_are_those_from_the_first_to_the_last_at_every_step(
    settings: dict[str, int], expected: list[int]
) -> None:
    chosen = choose_frames(WHOLE, FramesConfig(**settings))
    assert chosen.tolist() == expected
    part = take_frames(WHOLE, chosen)
    np.testing.assert_array_equal(part.timestamps_s, WHOLE.timestamps_s[expected])
    for index, frame in enumerate(part):
        assert (frame.index, frame.timestamp_s) == (index, 0.5 * expected[index])
        assert (frame.image == np.float32(expected[index] / 20)).all()
    assert (part is WHOLE) == (len(expected) == 20)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"first": 20}, "frames.first: expected a frame of whole, which has 0 to 19, found 20"),
        ({"last": 20}, "frames.last: expected a frame of whole, which has 0 to 19, found 20"),
        ({"first": 5, "last": 4}, r"frames.last: expected frames.first \(5\) or a later frame, found 4"),
    ],
)
def test_frames_that_do_not_exist_are_refused(settings: dict[str, int], message: str) -> None:
    with pytest.raises(AsfmError, match=message):
        choose_frames(WHOLE, FramesConfig(**settings))


def test_truth_is_that_of_the_chosen_frames() -> None:
    def read_truth(index: int) -> FrameTruth:
        return FrameTruth(np.full((4, 3), float(index)), np.zeros((4, 3), dtype=np.float32))

    part = take_truth(read_truth, np.array([4, 7]))
    assert (part(1).elevation_rad == 7).all()


def test_matches_keep_their_indices_and_get_the_numbers_of_the_part() -> None:
    keypoints = tuple(make_keypoints(np.full(3, 1.0 + frame), np.zeros(3)) for frame in range(8))
    index = np.array([[0, 1], [2, 0]])
    pairs = [(0, 2), (2, 4), (2, 5), (4, 6), (1, 3)]
    matches = tuple(Matches(*pair, index + number, np.full(2, number)) for number, pair in enumerate(pairs))
    part = take_matches(ExternalMatches(keypoints, matches), np.array([2, 4, 6]))
    assert [frame.range_m[0] for frame in part.keypoints] == [3.0, 5.0, 7.0]
    assert [(match.frame_a, match.frame_b) for match in part.matches] == [(0, 1), (1, 2)]
    np.testing.assert_array_equal(part.matches[0].index, index + 1)
    np.testing.assert_array_equal(part.matches[1].cost, np.full(2, 3))


def test_readings_of_other_sensors_are_not_cut() -> None:
    odometry = replace(WHOLE, navigation=None).navigation
    assert take_frames(WHOLE, np.arange(3)).navigation is odometry


def test_what_the_reader_found_is_said_of_the_whole_recording() -> None:
    whole = replace(WHOLE, diagnostics=(Diagnostic("odometry-gap", "frames 2-3 have none", ((2, 3),)),))
    (found,) = take_frames(whole, np.arange(5, 9)).diagnostics
    assert (found.code, found.frames) == ("odometry-gap", ())
    assert found.message == "in the whole recording: frames 2-3 have none"
