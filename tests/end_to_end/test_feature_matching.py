"""Feature matching of a sequence: the same as its stages called one by one, observed in order, patches freed."""

import numpy as np
import pytest

from asfm.config import Config, MatchingConfig
from asfm.frontend.denoising.echo_mask import detect_echo_mask
from asfm.frontend.features.keypoints import detect_keypoints
from asfm.frontend.matching.pair_matching import match_with_previous
from asfm.frontend.matching.patch_alignment import align_matches
from asfm.pipeline.feature_matching import extract_matches
from asfm.recorder import NullRecorder
from asfm.sequence import Sequence
from asfm.simulation.simulate import simulate
from asfm.stages import StageClock
from asfm.types import ExternalMatches, Keypoints, Matches

FRAMES = 4
CONFIG = Config(matching=MatchingConfig(max_gap=2))


@pytest.fixture(scope="module")
def tank() -> Sequence:
    return simulate("tank", frame_count=FRAMES, seed=1).sequence


def _match_one_by_one(sequence: Sequence) -> tuple[list[Keypoints], list[Matches]]:
    keypoints = [detect_keypoints(frame, detect_echo_mask(frame, CONFIG), sequence.sonar, CONFIG) for frame in sequence]
    matches: list[Matches] = []
    for index in range(len(keypoints)):
        found = match_with_previous(index, keypoints, CONFIG, sequence.sonar, None)
        matches += align_matches(found, keypoints, sequence.sonar, CONFIG)
    return keypoints, matches


def test_result_is_that_of_the_stages_one_by_one(tank: Sequence) -> None:
    clock = StageClock()
    keypoints, matches = extract_matches(tank, CONFIG, NullRecorder(), clock)
    expected_keypoints, expected_matches = _match_one_by_one(tank)
    assert [(pair.frame_a, pair.frame_b) for pair in matches] == [(0, 1), (1, 2), (0, 2), (2, 3), (1, 3)]
    for found, expected in zip(keypoints, expected_keypoints, strict=True):
        np.testing.assert_array_equal(found.row_column, expected.row_column)
    for pair, expected_pair in zip(matches, expected_matches, strict=True):
        assert len(pair) > 20
        np.testing.assert_array_equal(pair.index, expected_pair.index)
        np.testing.assert_array_equal(pair.sigma, expected_pair.sigma)
    (report,) = clock.reports
    assert report.counts["frames"] == FRAMES
    assert report.counts["keypoints"] == sum(len(found) for found in keypoints)
    assert report.counts["matches"] == sum(len(pair) for pair in matches)
    assert report.counts["rejected by ratio"] == sum(pair.count_rejected()["ratio"] for pair in matches)


def test_patches_are_freed_once_no_later_frame_needs_them(tank: Sequence) -> None:
    keypoints, _ = extract_matches(tank, CONFIG, NullRecorder(), StageClock())
    assert [len(found.patches) > 0 for found in keypoints] == [False, False, True, True]


def test_external_matches_take_the_place_of_those_of_asfm(tank: Sequence) -> None:
    keypoints, matches = _match_one_by_one(tank)
    pairs = tuple(pair for pair in matches if (pair.frame_a, pair.frame_b) == (0, 2))
    external = ExternalMatches(tuple(found.without_patches() for found in keypoints), pairs)
    found_keypoints, found = extract_matches(tank, CONFIG, NullRecorder(), StageClock(), external=external)
    ((a, b),) = {(pair.frame_a, pair.frame_b) for pair in found if len(pair)}
    assert (a, b) == (0, 2)
    for one, other in zip(found_keypoints, keypoints, strict=True):
        np.testing.assert_array_equal(one.row_column, other.row_column)
