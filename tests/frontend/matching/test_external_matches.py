"""External matches: the outlier filters apply without those on descriptors, and keep the matcher's own cost."""

import numpy as np
import pytest

from asfm.config import Config, Filter, MatchingConfig
from asfm.frontend.matching.external_matches import filter_external_matches
from asfm.geometry.poses import invert
from asfm.navigation.pose_prediction import PosePrediction
from asfm.types import ExternalMatches, Keypoints, Matches
from tests.worlds import B_FROM_A, MATCHING_SONAR, make_frame_pair

COUNT, WRONG = 60, 12
PAIR = make_frame_pair(count=COUNT, wrong=WRONG)
KEYPOINTS = [PAIR.keypoints_a, PAIR.keypoints_a, PAIR.keypoints_b]
COST = np.linspace(2.0, 3.0, COUNT)  # as ratios these would all fail the ratio test


def make_external(*pairs: tuple[int, int]) -> ExternalMatches:
    index = np.stack([np.arange(COUNT)] * 2, axis=1)
    without_patches = tuple(frame.without_patches() for frame in KEYPOINTS)
    return ExternalMatches(without_patches, tuple(Matches(a, b, index, COST) for a, b in pairs))


def filter_frame(
    frame: int, external: ExternalMatches, names: tuple[Filter, ...], prediction: PosePrediction | None = None
) -> list[Matches]:
    keypoints: list[Keypoints] = KEYPOINTS[: frame + 1]
    config = Config(matching=MatchingConfig(filters=names))
    return filter_external_matches(external, frame, keypoints, config, MATCHING_SONAR, prediction)


def test_descriptor_filters_do_not_apply_and_the_cost_is_the_matcher_s() -> None:
    """All descriptors are equal: nothing would pass the mutual or ratio filter."""
    (found,) = filter_frame(2, make_external((0, 2)), ("mutual", "ratio"))
    assert (found.frame_a, found.frame_b, found.filters) == (0, 2, ())
    assert found.index.tolist() == [[number, number] for number in range(COUNT)]
    np.testing.assert_array_equal(found.cost, COST)


@pytest.mark.parametrize("name", ["ssl", "planar", "clique"])
def test_other_filters_reject_wrong_matches(name: Filter) -> None:
    (found,) = filter_frame(2, make_external((0, 2)), ("mutual", "ratio", name))
    assert found.filters == (name,)
    assert set(found.index[:, 0].tolist()) >= set(range(WRONG, COUNT))
    assert len(found.rejected) >= 6 and found.rejected.max() < WRONG
    kept = found.index[:, 0]
    assert (found.cost > COST[kept]).all() if name == "ssl" else (found.cost == COST[kept]).all()


def test_the_arc_filter_needs_a_prediction() -> None:
    external = make_external((0, 2))
    (free,) = filter_frame(2, external, ("arc",))
    assert len(free) == COUNT
    poses = np.stack([np.eye(4), np.eye(4), invert(B_FROM_A)])
    (guided,) = filter_frame(2, external, ("arc",), PosePrediction(poses, 0.001, 0.002))
    assert set(guided.index[:, 0].tolist()) >= set(range(WRONG, COUNT))
    assert len(guided.rejected) >= 10


def test_pairs_of_a_frame_come_smallest_gap_first_and_those_of_other_frames_are_left_out() -> None:
    external = make_external((0, 1), (0, 2), (1, 2))
    for frame, expected in ((0, []), (1, [(0, 1)]), (2, [(1, 2), (0, 2)])):
        found = filter_frame(frame, external, ("ssl",))
        assert [(match.frame_a, match.frame_b) for match in found] == expected
