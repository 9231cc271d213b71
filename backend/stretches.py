"""Runs of frames, in words."""

import numpy as np

from asfm.types import BoolArray

MOST = 8
"""More stretches than these are counted, not named."""


def name_stretches(which: BoolArray, shortest: int = 1, last: int = 0) -> list[str]:
    """Name runs of true values among (N,): 3-5 means from 3 to 5.

    Args:
        which: one a frame, or one a step from a frame to the next.
        shortest: runs with fewer values are left out.
        last: what the end of a run is raised by: 1 where steps are named by the frames that they lie between.
    """
    edges = np.diff(np.concatenate([[0], which.astype(int), [0]]))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    long = stops - starts >= shortest
    names = [f"{a}-{b - 1 + last}" for a, b in zip(starts[long].tolist(), stops[long].tolist(), strict=True)]
    return [*names[:MOST], f"and {len(names) - MOST} more stretches"] if len(names) > MOST else names
