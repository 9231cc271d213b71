"""Selection of the observations that enter the graph: at most a given number of each track."""

import numpy as np

from asfm.types import BoolArray, FloatArray, Tracks


def cap_observations(tracks: Tracks, observed: BoolArray, sigma: FloatArray, max_views: int) -> BoolArray:
    """Keep at most a given number of observations of each track: the most informative ones.

    The information of a track comes from views that lie far apart and have small sigmas. Its first and last view are
    kept; those between are divided into sections of equal numbers of views, and the one with the smallest sigma is kept
    from each.

    Args:
        tracks: (O,) observations sorted by track and frame.
        observed: (O,) which may be kept.
        sigma: (O, 2) standard deviations of range_m and bearing_rad.
        max_views: number of observations kept of a track, at least 3.

    Returns:
        (O,) which are kept.
    """
    used = np.flatnonzero(observed)
    track = tracks.track[used]
    if not len(used):
        return observed.copy()
    first = np.flatnonzero(np.diff(track, prepend=-1))
    views = np.diff(np.append(first, len(used)))
    rank, count = np.arange(len(used)) - np.repeat(first, views), np.repeat(views, views)
    # Section 0 is the first view, section max_views - 1 the last.
    inner = np.maximum(count - 2, 1)
    section = np.where(
        rank == 0, 0, np.where(rank == count - 1, max_views - 1, 1 + (rank - 1) * (max_views - 2) // inner)
    )
    variance = (sigma[used] ** 2 / np.median(sigma[used] ** 2, axis=0)).sum(axis=1)
    order = np.lexsort((variance, section, track))
    best = np.ones(len(used), dtype=bool)
    best[1:] = (np.diff(track[order]) != 0) | (np.diff(section[order]) != 0)
    kept = np.zeros(len(tracks), dtype=bool)
    kept[used[order[best]]] = True
    kept[used[count <= max_views]] = True
    return kept
