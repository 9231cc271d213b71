"""Filter chain: outlier filters applied in sequence to the matches of many frame pairs."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from asfm.config import Config
from asfm.frontend.matching.filters import FILTERS
from asfm.frontend.matching.frame_pair import FramePair
from asfm.types import FloatArray, IntArray, Matches

NO_MATCHES = np.zeros((0, 2), dtype=np.int32)


def filter_pairs(
    pairs: Sequence[FramePair], frames: Sequence[tuple[int, int]], filters: Sequence[str], config: Config
) -> list[Matches]:
    """Apply filters in sequence, each to the matches that passed those before it.

    The cost of a match is its ratio plus what the filters add to it: it ranks matches when tracks are built. Every
    rejected match is kept with the filter that rejected it. The pairs do not influence each other.

    Args:
        pairs: the proposed matches of each pair of frames.
        frames: the indices (a, b) of each pair's frames.
        filters: names among :data:`asfm.frontend.matching.filters.FILTERS`.
        config: settings of the filters.
    """
    remaining, costs = list(pairs), [pair.nearest.ratio for pair in pairs]
    rejected: list[list[NDArray[np.int32]]] = [[] for _ in pairs]
    for name in filters:
        for number, (passes, added_cost) in enumerate(FILTERS[name](remaining, config)):
            rejected[number].append(remaining[number].index[~passes].astype(np.int32))
            costs[number] = (costs[number] + added_cost)[passes]
            remaining[number] = remaining[number].take(passes)
    return [
        _make_matches(a, b, pair.index, cost, parts, tuple(filters))
        for (a, b), pair, cost, parts in zip(frames, remaining, costs, rejected, strict=True)
    ]


def _make_matches(
    frame_a: int,
    frame_b: int,
    index: IntArray,
    cost: FloatArray,
    rejected: Sequence[NDArray[np.int32]],
    names: tuple[str, ...],
) -> Matches:
    """Join the matches that each filter rejected, in the filters' order."""
    by = np.repeat(np.arange(len(rejected), dtype=np.int8), np.array([len(part) for part in rejected], dtype=np.int64))
    return Matches(frame_a, frame_b, index, cost, np.concatenate([NO_MATCHES, *rejected]), by, names)
