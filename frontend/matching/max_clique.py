"""The largest clique of a graph whose edges mostly exist.

A clique is a set without conflicts, a conflict being a missing edge. Conflicts are few where matches are mostly right,
so the search is for the largest independent set of the graph of conflicts, by branch and reduce: whoever has at most
one conflict is taken; then the one with most conflicts is left out, or taken in. A set of n with a matching of m
conflicts holds at most n - m without conflict: a branch that cannot win is cut. Sets are the bits of an integer.
"""

import numpy as np

from asfm.types import BoolArray

BUDGET = 2000
"""Branches to try. Beyond it the largest set found so far stands, no smaller than the sum of 1 / (1 + conflicts)."""


def find_largest_clique(edges: BoolArray, budget: int = BUDGET) -> BoolArray:
    """Find the largest set of vertices that are all joined with each other.

    Exact while the budget lasts. After that it is at least what leaving out the most conflicted, one by one, gives:
    the sum over the vertices of 1 / (1 + conflicts) or more (Griggs 1983).

    Args:
        edges: (M, M) symmetric; the diagonal does not matter.
        budget: branches to try, one at least.

    Returns:
        (M,) which vertices; of equally large sets always the same.
    """
    conflicts = ~edges
    np.fill_diagonal(conflicts, False)
    packed = np.packbits(conflicts, axis=1, bitorder="little")
    neighbours = [int.from_bytes(row.tobytes(), "little") for row in packed]
    chosen = _search(neighbours, budget)
    return np.array([bool(chosen >> vertex & 1) for vertex in range(len(edges))], dtype=bool)


def _search(neighbours: list[int], budget: int) -> int:
    """Branch and reduce, deepest first: the largest set without conflict, as bits."""
    best = 0
    stack = [((1 << len(neighbours)) - 1, 0)]
    while stack and (budget > 0 or not best):  # the first descent is the greedy one, and always ends
        budget -= 1
        alive, taken = stack.pop()
        alive, taken, worst = _reduce(alive, taken, neighbours)
        if worst < 0:
            best = max(best, taken, key=int.bit_count)
        elif taken.bit_count() + _bound(alive, neighbours) > best.bit_count():
            without = alive & ~(1 << worst)
            stack.append((without & ~neighbours[worst], taken | 1 << worst))
            stack.append((without, taken))
    return best


def _reduce(alive: int, taken: int, neighbours: list[int]) -> tuple[int, int, int]:
    """Take whoever has at most one conflict until nobody has; give the one with most conflicts, or -1."""
    while True:
        worst, most, changed = -1, 1, False
        left = alive
        while left:
            bit = left & -left
            left ^= bit
            vertex = bit.bit_length() - 1
            against = neighbours[vertex] & alive
            count = against.bit_count()
            if count <= 1:
                taken |= bit
                alive &= ~(bit | against)
                left &= ~against
                changed = True
            elif count > most:
                worst, most = vertex, count
        if not changed:
            return alive, taken, worst


def _bound(alive: int, neighbours: list[int]) -> int:
    """Bound from above how many of the living can be taken: of each conflict of a matching only one can."""
    bound = alive.bit_count()
    while alive:
        bit = alive & -alive
        alive ^= bit
        against = neighbours[bit.bit_length() - 1] & alive
        if against:
            alive ^= against & -against
            bound -= 1
    return bound
