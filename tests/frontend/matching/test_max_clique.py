"""Maximum clique against exhaustive search, and its guaranteed size where the search is cut short."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asfm.frontend.matching.max_clique import find_largest_clique
from asfm.types import BoolArray


def random_graph(rng: np.random.Generator, count: int, share: float) -> BoolArray:
    upper = np.triu(rng.random((count, count)) < share, 1)
    return np.asarray(upper | upper.T)


def is_clique(edges: BoolArray, chosen: BoolArray) -> bool:
    inside = edges[np.ix_(chosen, chosen)]
    return bool((inside | np.eye(len(inside), dtype=bool)).all())


def largest_by_exhaustive_search(edges: BoolArray) -> int:
    count = len(edges)
    for size in range(count, 0, -1):
        for members in combinations(range(count), size):
            if is_clique(edges, np.isin(np.arange(count), members)):
                return size
    return 0


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 11), st.sampled_from([0.0, 0.3, 0.5, 0.7, 0.9, 1.0]), st.integers(0, 2**32 - 1))
def test_clique_is_as_large_as_by_exhaustive_search(count: int, share: float, seed: int) -> None:
    edges = random_graph(np.random.default_rng(seed), count, share)
    chosen = find_largest_clique(edges, max_branches=10**6)
    assert chosen.shape == (count,) and chosen.dtype == np.bool_
    assert is_clique(edges, chosen)
    assert chosen.sum() == largest_by_exhaustive_search(edges)


@pytest.mark.parametrize("seed", range(5))
def test_a_planted_clique_is_found(seed: int) -> None:
    """Correct matches are consistent with each other, wrong ones with some by chance."""
    rng = np.random.default_rng(seed)
    edges = random_graph(rng, 120, 0.6)
    planted = rng.permutation(120) < 80
    edges |= planted[:, None] & planted
    np.testing.assert_array_equal(find_largest_clique(edges), planted)


@pytest.mark.parametrize("seed", range(5))
def test_a_search_of_one_branch_keeps_the_guaranteed_size(seed: int) -> None:
    rng = np.random.default_rng(seed)
    edges = random_graph(rng, 150, 0.5)
    chosen = find_largest_clique(edges, max_branches=1)
    conflicts = (~edges).sum(axis=1) - 1
    assert is_clique(edges, chosen)
    assert chosen.sum() >= (1 / (1 + conflicts)).sum()


def test_result_is_deterministic_and_ignores_the_diagonal() -> None:
    edges = random_graph(np.random.default_rng(3), 30, 0.5)
    filled = edges | np.eye(30, dtype=bool)
    before = filled.copy()
    np.testing.assert_array_equal(find_largest_clique(edges), find_largest_clique(filled))
    np.testing.assert_array_equal(filled, before)


def test_graphs_of_no_vertex_and_of_one() -> None:
    assert find_largest_clique(np.zeros((0, 0), dtype=bool)).shape == (0,)
    assert find_largest_clique(np.zeros((1, 1), dtype=bool)).tolist() == [True]
