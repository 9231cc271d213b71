"""Where the points of a run's tracks truly are, as a simulation knows, and how far the observations lie from them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from asfm.evaluation.matching import BEARING_TOLERANCE_RAD, RANGE_TOLERANCE_M, look_up_elevation
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.types import BoolArray, FloatArray, FrameTruth, IntArray, Tracks

CANDIDATES = 15
"""Of a longer track so many observations, evenly spread, propose where its point is."""


@dataclass(frozen=True)
class TruePoints:
    """The true point of each track, and where its observations would lie if they were exact."""

    xyz_m: FloatArray
    """(T, 3) in the true world, zero where unknown."""
    known: BoolArray
    """(T,) false where nothing echoes near any observation of the track."""
    range_m: FloatArray
    """(O,) the true point seen from each observation's true pose."""
    bearing_rad: FloatArray
    """(O,)"""
    near: BoolArray
    """(O,) the observation lies within the tolerance of its true place; the others belong to another point."""


def find_true_points(
    tracks: Tracks, sonar: SonarModel, sonar_from_world: FloatArray, read_truth: Callable[[int], FrameTruth]
) -> TruePoints:
    """Find the point that each track is of.

    An observation that echoes proposes the point at its own true elevation: equation (2). The proposal that most
    observations of the track agree with wins, and the point is the mean of what those propose, so that no observation
    counts as exact.

    Args:
        tracks: (O,) observations, sorted by track.
        sonar: gives the pixel grid.
        sonar_from_world: (N, 4, 4) true poses of the frames.
        read_truth: gives the true elevations of a frame.
    """
    pose = sonar_from_world[tracks.frame]
    elevation_rad, echoes = _look_up_elevations(tracks, sonar, read_truth)
    proposed_m = transform(invert(pose), back_project(tracks.range_m, tracks.bearing_rad, elevation_rad))
    winner, known = _vote(tracks, pose, proposed_m, echoes)
    near, _, _ = _judge(tracks, pose, proposed_m[winner])
    apart_m = np.linalg.norm(proposed_m - proposed_m[winner][tracks.track], axis=1)
    reach_m = np.hypot(RANGE_TOLERANCE_M, BEARING_TOLERANCE_RAD * tracks.range_m)
    counts = near & echoes & (apart_m <= reach_m)
    xyz_m = np.zeros((tracks.count, 3))
    for axis in range(3):
        xyz_m[:, axis] = np.bincount(tracks.track, counts * proposed_m[:, axis], minlength=tracks.count)
    xyz_m /= np.maximum(np.bincount(tracks.track, counts, minlength=tracks.count), 1)[:, None]
    near, range_m, bearing_rad = _judge(tracks, pose, xyz_m)
    return TruePoints(xyz_m, known, range_m, bearing_rad, near & known[tracks.track])


def measure_noise(tracks: Tracks, truth: TruePoints) -> FloatArray | None:
    """Measure the standard deviations (2,) of range_m and bearing_rad of the observations near their true places.

    The mean of a track's n observations is where its point is taken to be, so that (n - 1) / n of their variance is
    seen. None where no track has two observations near its point.
    """
    views = np.bincount(tracks.track[truth.near], minlength=tracks.count)
    chosen = truth.near & (views >= 2)[tracks.track]
    if not chosen.any():
        return None
    freedom = float(np.sum(views[views >= 2] - 1))
    range_error_m = (tracks.range_m - truth.range_m)[chosen]
    bearing_error_rad = (tracks.bearing_rad - truth.bearing_rad)[chosen]
    return np.sqrt(np.array([np.sum(range_error_m**2), np.sum(bearing_error_rad**2)]) / freedom)


def _look_up_elevations(
    tracks: Tracks, sonar: SonarModel, read_truth: Callable[[int], FrameTruth]
) -> tuple[FloatArray, BoolArray]:
    """Take the true elevation at each observation's pixel: (O,), zero where nothing echoes, and (O,) whether any."""
    row_column = np.stack([sonar.row_at_range(tracks.range_m), sonar.column_at_bearing(tracks.bearing_rad)], axis=1)
    elevation_rad, echoes = np.zeros(len(tracks)), np.zeros(len(tracks), dtype=bool)
    for frame in np.unique(tracks.frame).tolist():
        here = tracks.frame == frame
        elevation_rad[here], echoes[here] = look_up_elevation(row_column[here], read_truth(frame).elevation_rad)
    return elevation_rad, echoes


def _vote(tracks: Tracks, pose: FloatArray, proposed_m: FloatArray, echoes: BoolArray) -> tuple[IntArray, BoolArray]:
    """Choose the observation of each track whose proposal has the least truncated cost: (T,), and whether any is."""
    first = np.searchsorted(tracks.track, np.arange(tracks.count))
    length = np.diff(first, append=len(tracks))
    winner, least = first.copy(), np.full(tracks.count, np.inf)
    rounds = min(CANDIDATES, int(length.max(initial=0)))
    for turn in range(rounds):
        candidate = first + turn * length // rounds
        _, range_m, bearing_rad = _judge(tracks, pose, proposed_m[candidate])
        square = ((range_m - tracks.range_m) / RANGE_TOLERANCE_M) ** 2
        square += ((bearing_rad - tracks.bearing_rad) / BEARING_TOLERANCE_RAD) ** 2
        cost = np.bincount(tracks.track, np.minimum(square, 1.0), minlength=tracks.count)
        cost[~echoes[candidate]] = np.inf
        better = cost < least
        winner[better], least[better] = candidate[better], cost[better]
    return winner, np.isfinite(least)


def _judge(tracks: Tracks, pose: FloatArray, xyz_m: FloatArray) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Project (T, 3) points into the observations' frames: (O,) whether near what is seen, range_m, bearing_rad."""
    range_m, bearing_rad, _ = project(transform(pose, xyz_m[tracks.track]))
    turn_rad = np.remainder(bearing_rad - tracks.bearing_rad + np.pi, 2 * np.pi) - np.pi
    near = (np.abs(range_m - tracks.range_m) <= RANGE_TOLERANCE_M) & (np.abs(turn_rad) <= BEARING_TOLERANCE_RAD)
    return np.asarray(near), range_m, bearing_rad
