"""Which observations enter the graph where a landmark has more than it needs."""

import numpy as np

from asfm.types import BoolArray, FloatArray, Tracks


def cap_observations(tracks: Tracks, observed: BoolArray, sigma: FloatArray, most: int) -> BoolArray:
    """Leave each track at most so many observations: those that inform most.

    What a track tells comes from how far its views lie apart and from how sharp they are. It is cut into as many
    stretches of equal numbers of views, and the sharpest view of each stays; so does its first and its last.

    Args:
        tracks: (O,) observations sorted by track and frame.
        observed: (O,) those that may be kept.
        sigma: (O, 2) standard deviations of range_m and bearing_rad.
        most: at least 3.

    Returns:
        (O,) those that are kept.
    """
    used = np.flatnonzero(observed)
    track = tracks.track[used]
    if not len(used):
        return observed.copy()
    first = np.flatnonzero(np.diff(track, prepend=-1))
    views = np.diff(np.append(first, len(used)))
    rank, count = np.arange(len(used)) - np.repeat(first, views), np.repeat(views, views)
    # The stretches lie between the first view, number 0, and the last.
    inner = np.maximum(count - 2, 1)
    stretch = np.where(rank == 0, 0, np.where(rank == count - 1, most - 1, 1 + (rank - 1) * (most - 2) // inner))
    blur = (sigma[used] ** 2 / np.median(sigma[used] ** 2, axis=0)).sum(axis=1)
    order = np.lexsort((blur, stretch, track))
    best = np.ones(len(used), dtype=bool)
    best[1:] = (np.diff(track[order]) != 0) | (np.diff(stretch[order]) != 0)
    kept = np.zeros(len(tracks), dtype=bool)
    kept[used[order[best]]] = True
    kept[used[count <= most]] = True
    return kept
