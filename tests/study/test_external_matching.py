"""External matchers: functions that are called for every pair of frames, and one line for whatever they do wrong."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asfm.errors import AsfmError
from asfm.sequence import Sequence
from asfm.study.cell import External
from asfm.study.external_matching import match_by_function
from asfm.study.sequence_provider import StudySequence
from asfm.types import Frame
from tests.worlds import make_vehicle_sequence

ROWS, COLUMNS, FRAMES = 20, 10, 4
MATCHER = External("mine", "content", function="my_matcher:match")


@pytest.fixture
def opened() -> StudySequence:
    from dataclasses import replace

    from asfm.geometry.sonar import SonarModel

    def read_frame(index: int) -> Frame:
        image = np.full((ROWS, COLUMNS), index / 10, dtype=np.float32)
        return Frame(index, float(index), image, np.zeros(image.shape, dtype=bool))

    base = make_vehicle_sequence()
    sonar = SonarModel.evenly_spaced("test", (1.0, 3.0), (-0.5, 0.5), (ROWS, COLUMNS), 0.2)
    sequence: Sequence = replace(base, sonar=sonar, timestamps_s=base.timestamps_s[:FRAMES], read_frame=read_frame)
    return StudySequence(Path("x"), sequence, np.arange(FRAMES), sequence, None)


@pytest.fixture
def use(monkeypatch: pytest.MonkeyPatch) -> Callable[[Any], None]:
    import sys
    from types import ModuleType

    def install(function: Any) -> None:
        module = ModuleType("my_matcher")
        module.match = function  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "my_matcher", module)

    return install


def test_the_function_is_called_for_every_pair_up_to_the_gap(opened: StudySequence, use: Any) -> None:
    pairs = []

    def match(a: Any, b: Any) -> Any:
        pairs.append((round(float(a[0, 0]) * 10), round(float(b[0, 0]) * 10)))
        number = pairs[-1][0]
        return [[2, 3], [4, 5 + number]], [[2, 3], [1, 1]], [[0, 0], [1, 1], [0, 0]]

    use(match)
    found = match_by_function(MATCHER, opened, 2)
    assert pairs == [(0, 1), (1, 2), (0, 2), (2, 3), (1, 3)]
    assert [(match.frame_a, match.frame_b, len(match)) for match in found.matches] == [(a, b, 2) for a, b in pairs]
    keypoints = found.keypoints[1]
    assert len(keypoints) == 3, "a keypoint that several pairs share is one"
    np.testing.assert_allclose(keypoints.row_column[0], [3.5, 2.5])
    sonar = opened.sequence.sonar
    np.testing.assert_allclose(keypoints.range_m[0], sonar.range_m[3])
    np.testing.assert_allclose(keypoints.bearing_rad[0], sonar.bearing_rad[2])
    first = found.matches[0]
    assert found.keypoints[1].row_column[first.index[0, 1]].tolist() == [3.5, 2.5]


def test_no_matches_are_fine(opened: StudySequence, use: Any) -> None:
    use(lambda a, b: (np.zeros((0, 2)), [], []))
    found = match_by_function(MATCHER, opened, 1)
    assert [len(frame) for frame in found.keypoints] == [0] * FRAMES
    assert [len(match) for match in found.matches] == [0] * (FRAMES - 1)


GOOD = [[1.0, 2.0]]


@pytest.mark.parametrize(
    ("result", "message"),
    [
        (GOOD, "expected keypoints, keypoints and matches, found 'list'"),
        ((GOOD, GOOD, [[0, 1]]), "match 0 has the index 1, expected one of 1 keypoints"),
        ((GOOD, GOOD, [[-1, 0]]), "match 0 has the index -1"),
        ((GOOD, GOOD, [[0.5, 0]]), "expected whole numbers as matches"),
        ((GOOD, GOOD, [[np.nan, 0]]), "expected whole numbers as matches"),
        ((GOOD, [[np.nan, 1]], []), r"keypoints of the second image: number 0 is at .*nan"),
        (([[1, 99]], GOOD, []), "keypoints of the first image: number 0 is at .* outside of 10 x 20 pixels"),
        ((GOOD, GOOD, [[0, 0, 0]]), r"matches: expected numbers \(N, 2\), found the shape \[1, 3\]"),
        ((GOOD, "many", []), r"second image: expected numbers \(N, 2\), found 'str'"),
    ],
)
def test_what_is_no_result_is_one_line(opened: StudySequence, use: Any, result: Any, message: str) -> None:
    use(lambda a, b: result)
    with pytest.raises(AsfmError, match=message) as caught:
        match_by_function(MATCHER, opened, 1)
    assert "external matcher mine, frames 0 and 1" in str(caught.value)


def test_functions_that_cannot_be_called_or_raise_are_named(opened: StudySequence, use: Any) -> None:
    def fail(a: Any, b: Any) -> Any:
        raise KeyError("weights")

    use(fail)
    with pytest.raises(AsfmError, match=r"the function raised KeyError: .*weights"):
        match_by_function(MATCHER, opened, 1)
    use("no function")
    with pytest.raises(AsfmError, match="expected a function 'match' in my_matcher, found none"):
        match_by_function(MATCHER, opened, 1)
    with pytest.raises(AsfmError, match=r"cannot import no_such_matcher: ModuleNotFoundError"):
        match_by_function(External("mine", "", function="no_such_matcher:match"), opened, 1)


def test_a_function_cannot_change_the_images(opened: StudySequence, use: Any) -> None:
    seen = []

    def spoil(a: Any, b: Any) -> Any:
        seen.append(float(b[0, 0]))
        b[:] = 9
        return GOOD, GOOD, []

    use(spoil)
    match_by_function(MATCHER, opened, 2)
    assert max(seen) < 1


def test_a_learned_matcher_is_told_the_sonar(opened: StudySequence, monkeypatch: pytest.MonkeyPatch) -> None:
    told = []

    def match(a: Any, b: Any, sonar: Any = None) -> Any:
        told.append(sonar)
        return GOOD, GOOD, [[0, 0]]

    monkeypatch.setattr("asfm.learned.catalogue.find_learned_matcher", {"xfeat": match}.__getitem__)
    threads: list[bool] = []
    monkeypatch.setattr("asfm.learned.weights.use_one_thread", lambda: threads.append(True))
    found = match_by_function(External("xfeat", "content", learned=True), opened, 1)
    assert told == [opened.sequence.sonar] * (FRAMES - 1) and threads == [True]
    assert [len(match) for match in found.matches] == [1] * (FRAMES - 1)
