"""Standstill: frames over which features stay where they are, so that no motion is seen.

Where the sonar moves, a feature's range and bearing drift apart over more and more frames. Where it stands, two
observations of a feature differ as little over many frames as from one frame to the next.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from asfm.diagnostics import Diagnostic, frame_runs
from asfm.navigation.outlier_filter import MAD_TO_SIGMA
from asfm.types import BoolArray, FloatArray, IntArray, Tracks

WINDOW_STEPS = 15
"""Steps over which a window of frames is examined."""
LONG_GAP = 12
"""Frames from which on a gap counts as long, in a window."""
MIN_PAIRS = 150
"""Fewest pairs of observations one frame apart that can tell."""
MIN_PAIRS_OF_FRAME = 40
"""Fewest pairs with the first or the last frame of a window."""
MAX_GROWTH = 2.0
"""Largest difference of observations far apart in time, over that of observations one frame apart: errors of features
on real sediment change slowly, and grow by this factor at a sonar that stands on a tripod."""
MAX_DIFFERENCE = float(np.sqrt(2.0))
"""Largest difference of two observations of a feature, in stated sigmas of one: what their noise explains."""
HELD_SHARE = 0.1
"""Sigma of a step of a standing sonar, over that of a feature: motion that is not seen is slower than this."""


@dataclass(frozen=True)
class _Differences:
    """Of two observations of one feature in different frames."""

    frames: IntArray
    """(M, 2)"""
    values: FloatArray
    """(M, 2) of range and bearing, in sigmas of one observation."""

    def __len__(self) -> int:
        return len(self.frames)

    def select(self, chosen: BoolArray) -> "_Differences":
        """Return the (M,) chosen ones."""
        return _Differences(self.frames[chosen], self.values[chosen])


def find_standstill(tracks: Tracks, frame_count: int, sigma: FloatArray) -> BoolArray:
    """Find the steps during which no motion is seen.

    Args:
        tracks: built without known poses.
        frame_count: N.
        sigma: (O, 2) standard deviations of range in m and bearing in rad.

    Returns:
        (N - 1,) which steps from a frame to the next are part of a standstill; none where too few features tell.
    """
    still = np.zeros(max(frame_count - 1, 0), dtype=bool)
    near = _differences(tracks, sigma, [1])
    far = _differences(tracks, sigma, range(LONG_GAP, WINDOW_STEPS + 1))
    for first in range(len(still) - WINDOW_STEPS + 1):
        last = first + WINDOW_STEPS
        noise, inside = _within(near, first, last), _within(far, first, last)
        # The first and the last frame by themselves, as the motion may begin or end with them.
        groups = (inside, inside.select(inside.frames[:, 0] == first), inside.select(inside.frames[:, 1] == last))
        if len(noise) >= MIN_PAIRS and all(_has_stayed(noise, group) for group in groups):
            still[first:last] = True
    for first, last in frame_runs(still):
        if _drifts(tracks, sigma, first, last + 1):
            still[first : last + 1] = False
    return still


def standstill_sigma(sigma: FloatArray) -> FloatArray:
    """Return the (2,) standard deviations of a step of a standing sonar, from (O, 2) sigmas of range and bearing.

    Returns:
        Rotation in rad and translation in m, each axis.
    """
    range_m, bearing_rad = np.median(sigma, axis=0)
    return HELD_SHARE * np.array([bearing_rad, range_m])


def diagnose_standstill(sigma: FloatArray) -> Diagnostic:
    """Say that a whole recording shows no motion, and how much of it would have been seen.

    Args:
        sigma: (O, 2) standard deviations of range in m and bearing in rad.
    """
    range_m, bearing_rad = np.median(sigma, axis=0)
    return Diagnostic(
        "no-motion-seen",
        "no motion is seen in any frame: features stay where they are, within about "
        f"{range_m:.2g} m in range and {np.rad2deg(bearing_rad):.2g} degrees in bearing; the poses are held, and "
        "points have no height, which takes motion to be seen",
    )


def _drifts(tracks: Tracks, sigma: FloatArray, first: int, last: int) -> bool:
    """Tell whether features drift slowly over the frames of a long standstill, which its windows are too short for."""
    near, gap = _within(_differences(tracks, sigma, [1]), first, last), 2 * WINDOW_STEPS
    while gap <= last - first:
        far = _within(_differences(tracks, sigma, [gap]), first, last)
        if len(far) >= MIN_PAIRS and not _has_stayed(near, far):
            return True
        gap *= 2
    return False


def _has_stayed(near: _Differences, far: _Differences) -> bool:
    """Tell whether observations far apart in time differ hardly more than those one frame apart."""
    if len(far) < MIN_PAIRS_OF_FRAME:
        return False
    noise, moved = _robust_size(near.values), _robust_size(far.values)
    return bool((moved <= np.minimum(MAX_GROWTH * noise, MAX_DIFFERENCE)).all())


def _robust_size(values: FloatArray) -> FloatArray:
    """Return the (2,) standard deviations of (M, 2) differences about zero, which outliers do not move."""
    return np.asarray(MAD_TO_SIGMA * np.median(np.abs(values), axis=0))


def _within(differences: _Differences, first: int, last: int) -> _Differences:
    """Return the differences whose two frames lie in first..last."""
    frames = differences.frames
    return differences.select((frames[:, 0] >= first) & (frames[:, 1] <= last))


def _differences(tracks: Tracks, sigma: FloatArray, gaps: Iterable[int]) -> _Differences:
    """Return the differences of the observations of a feature that are one of the gaps apart."""
    stride = 2 * (int(tracks.frame.max(initial=0)) + 1)
    key = tracks.track * stride + tracks.frame
    ones, others = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for gap in gaps if len(key) else ():
        other = np.minimum(np.searchsorted(key, key + gap), len(key) - 1)
        ones.append(np.flatnonzero((key[other] == key + gap) & (tracks.track[other] == tracks.track)))
        others.append(other[ones[-1]])
    one, other = np.concatenate(ones), np.concatenate(others)
    observed = np.column_stack([tracks.range_m, tracks.bearing_rad])
    values = (observed[other] - observed[one]) / np.maximum(sigma[one], sigma[other])
    return _Differences(np.column_stack([tracks.frame[one], tracks.frame[other]]), values)
