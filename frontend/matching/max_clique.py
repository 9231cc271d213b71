"""Maximum clique of a dense graph by branch and reduce.

A clique is an independent set of the complement graph, whose edges are called conflicts here. Where most matches are
correct there are few conflicts, so the search runs on that graph. Reduction: a vertex with at most one conflict is
taken. Branching: the vertex with most conflicts is excluded or taken. Bound: n vertices with a matching of m conflicts
hold an independent set of at most n - m. Vertex sets are the bits of an integer.
"""

import numpy as np

from asfm.types import BoolArray

MAX_BRANCHES = 2000
"""Branches searched before the largest set found so far is returned."""


def find_largest_clique(edges: BoolArray, max_branches: int = MAX_BRANCHES) -> BoolArray:
    """Find the maximum clique of a graph.

    Exact if the search ends within the branches allowed. Otherwise the clique is at least as large as the greedy one,
    which excludes the vertex with most conflicts until no conflict is left: at least the sum over the vertices of
    1 / (1 + conflicts) (Griggs 1983).

    Args:
        edges: (M, M) symmetric adjacency matrix; its diagonal is ignored.
        max_branches: branches to search, at least one.

    Returns:
        (M,) which vertices are in the clique; deterministic among cliques of equal size.
    """
    conflicts = ~edges
    np.fill_diagonal(conflicts, False)
    packed = np.packbits(conflicts, axis=1, bitorder="little")
    neighbours = [int.from_bytes(row.tobytes(), "little") for row in packed]
    chosen = _search(neighbours, max_branches)
    return np.array([bool(chosen >> vertex & 1) for vertex in range(len(edges))], dtype=bool)


def _search(neighbours: list[int], max_branches: int) -> int:
    """Return the largest independent set of the conflict graph as bits, by depth-first branch and reduce."""
    best = 0
    stack = [((1 << len(neighbours)) - 1, 0)]
    while stack and (max_branches > 0 or not best):  # the first descent, the greedy one, is always finished
        max_branches -= 1
        remaining, taken = stack.pop()
        remaining, taken, worst = _reduce(remaining, taken, neighbours)
        if worst < 0:
            best = max(best, taken, key=int.bit_count)
        elif taken.bit_count() + _bound(remaining, neighbours) > best.bit_count():
            without = remaining & ~(1 << worst)
            stack.append((without & ~neighbours[worst], taken | 1 << worst))
            stack.append((without, taken))
    return best


def _reduce(remaining: int, taken: int, neighbours: list[int]) -> tuple[int, int, int]:
    """Take vertices with at most one conflict until none is left; return also the vertex with most, or -1."""
    while True:
        worst, most, changed = -1, 1, False
        unvisited = remaining
        while unvisited:
            bit = unvisited & -unvisited
            unvisited ^= bit
            vertex = bit.bit_length() - 1
            conflicting = neighbours[vertex] & remaining
            count = conflicting.bit_count()
            if count <= 1:
                taken |= bit
                remaining &= ~(bit | conflicting)
                unvisited &= ~conflicting
                changed = True
            elif count > most:
                worst, most = vertex, count
        if not changed:
            return remaining, taken, worst


def _bound(remaining: int, neighbours: list[int]) -> int:
    """Return an upper bound of the independent set: of each pair of a greedy matching at most one is taken."""
    bound = remaining.bit_count()
    while remaining:
        bit = remaining & -remaining
        remaining ^= bit
        conflicting = neighbours[bit.bit_length() - 1] & remaining
        if conflicting:
            remaining ^= conflicting & -conflicting
            bound -= 1
    return bound
