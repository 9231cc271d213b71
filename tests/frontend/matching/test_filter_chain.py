"""Filter chain: order of the filters, costs, record of the rejected matches, independence of frame pairs."""

from itertools import permutations
from typing import get_args

import numpy as np
import pytest

from asfm.config import Config, Filter, MatchingConfig
from asfm.frontend.matching.filter_chain import filter_pairs
from asfm.frontend.matching.filters import FILTERS
from asfm.frontend.matching.frame_pair import FramePair
from asfm.types import Matches
from tests.worlds import make_frame_pair

COUNT, WRONG = 60, 12
CONFIG = Config()


def filter_one(pair: FramePair, names: tuple[str, ...]) -> Matches:
    return filter_pairs([pair], [(3, 5)], names, CONFIG)[0]


def apply_one_by_one(pair: FramePair, names: tuple[str, ...]) -> tuple[dict[int, float], dict[int, str]]:
    """Return the costs of accepted matches and the filter of each rejected one, by keypoint, from a plain loop."""
    cost = dict(zip(pair.index[:, 0].tolist(), pair.nearest.ratio.tolist(), strict=True))
    rejected_by: dict[int, str] = {}
    for name in names:
        subset = pair.take(np.isin(pair.index[:, 0], list(cost)))
        ((passes, added_cost),) = FILTERS[name]([subset], CONFIG)
        for keypoint, ok, added in zip(subset.index[:, 0].tolist(), passes, added_cost.tolist(), strict=True):
            cost[keypoint] += added
            if not ok:
                del cost[keypoint]
                rejected_by[keypoint] = name
    return cost, rejected_by


@pytest.mark.parametrize("names", list(permutations(("ssl", "planar", "arc"))))
def test_the_first_filter_that_rejects_a_match_is_recorded(names: tuple[str, ...]) -> None:
    pair = make_frame_pair()
    found = filter_one(pair, names)
    cost, rejected_by = apply_one_by_one(pair, names)
    assert (found.frame_a, found.frame_b, found.filters) == (3, 5, names)
    assert found.index[:, 0].tolist() == list(cost) == list(range(WRONG, COUNT))
    np.testing.assert_allclose(found.cost, list(cost.values()), rtol=1e-12)
    recorded = [names[number] for number in found.rejected_by]
    assert dict(zip(found.rejected[:, 0].tolist(), recorded, strict=True)) == rejected_by
    assert sum(found.count_rejected().values()) == WRONG


def test_without_filters_all_matches_pass_and_the_cost_is_the_ratio() -> None:
    pair = make_frame_pair()
    found = filter_one(pair, ())
    assert len(found) == COUNT and found.filters == () and found.count_rejected() == {}
    np.testing.assert_array_equal(found.cost, pair.nearest.ratio)


def test_pairs_do_not_influence_each_other_and_the_configured_filters_are_ignored() -> None:
    pairs, frames = [make_frame_pair(0), make_frame_pair(1, count=20, wrong=3)], [(0, 1), (1, 2)]
    names: tuple[Filter, ...] = ("ratio", "ssl", "arc")
    together = filter_pairs(pairs, frames, names, Config(matching=MatchingConfig(filters=("mutual",))))
    for pair, (a, b), found in zip(pairs, frames, together, strict=True):
        alone = filter_one(pair, names)
        assert (found.frame_a, found.frame_b, found.filters) == (a, b, names)
        np.testing.assert_array_equal(found.index, alone.index)
        np.testing.assert_allclose(found.cost, alone.cost, rtol=1e-6)
    assert filter_pairs([], [], names, CONFIG) == []


@pytest.mark.parametrize("count", [0, 1])
def test_no_match_or_a_single_one_passes_all_filters(count: int) -> None:
    found = filter_one(make_frame_pair(count=count, wrong=0), get_args(Filter))
    assert found.index.shape == (count, 2) and found.rejected.shape == (0, 2)
    assert found.cost.shape == (count,) and np.isfinite(found.cost).all()


def test_a_filter_applied_again_keeps_its_number() -> None:
    found = filter_one(make_frame_pair(), ("ratio", "arc"))
    again = found.reject(np.arange(len(found)) < 5, "arc")
    assert again.filters == ("ratio", "arc")
    assert again.count_rejected() == {"ratio": WRONG, "arc": 5}
    assert len(again) == len(found) - 5 and len(found) == COUNT - WRONG


def test_matches_without_filters_have_no_rejected_ones() -> None:
    matches = Matches(0, 1, np.zeros((2, 2), dtype=np.int64), np.zeros(2))
    assert matches.count_rejected() == {} and matches.rejected.shape == (0, 2)
