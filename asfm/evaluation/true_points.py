"""True points of tracks, from a simulation's elevations, and the noise of the observations about them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from asfm.evaluation.true_positions import TRUTH_TOLERANCE, look_up_elevation
from asfm.geometry.poses import angle_difference, invert, transform, wrap_angle
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.types import BoolArray, FloatArray, FrameTruth, IntArray, Tracks

MAX_CANDIDATES = 15
"""Observations of a track, evenly spread, that propose its point."""


@dataclass(frozen=True)
class TruePoints:
    """The true point of each track, and its exact projections at the observations."""

    xyz_m: FloatArray
    """(T, 3) in the true world, zero where unknown."""
    known: BoolArray
    """(T,) false where nothing echoes near any of the observations that propose the track's point."""
    range_m: FloatArray
    """(O,) projection of the true point at each observation's true pose."""
    bearing_rad: FloatArray
    """(O,)"""
    inlier: BoolArray
    """(O,) the observation lies within the tolerance of that projection; the others belong to another point."""


def find_true_points(
    tracks: Tracks, sonar: SonarModel, sonar_from_world: FloatArray, read_truth: Callable[[int], FrameTruth]
) -> TruePoints:
    """Find the true point of each track.

    Each observation with a true elevation proposes a point. The proposal with the smallest truncated cost over the
    track's observations is chosen (MSAC, Torr and Zisserman 2000), and the point is the mean of the proposals that
    agree with it, so that no observation counts as exact.

    Args:
        tracks: (O,) observations, sorted by track.
        sonar: pixel grid.
        sonar_from_world: (N, 4, 4) true poses of the frames.
        read_truth: returns the true elevations of a frame.
    """
    pose = sonar_from_world[tracks.frame]
    elevation_rad, echoes = _look_up_elevations(tracks, sonar, read_truth)
    proposed_m = transform(invert(pose), back_project(tracks.range_m, tracks.bearing_rad, elevation_rad))
    best, known = _choose_proposals(tracks, pose, proposed_m, echoes)
    inlier, _, _ = _classify(tracks, pose, proposed_m[best])
    distance_m = np.linalg.norm(proposed_m - proposed_m[best][tracks.track], axis=1)
    max_distance_m = np.hypot(TRUTH_TOLERANCE.range_m, TRUTH_TOLERANCE.bearing_rad * tracks.range_m)
    agrees = inlier & echoes & (distance_m <= max_distance_m)
    xyz_m = np.zeros((tracks.count, 3))
    for axis in range(3):
        xyz_m[:, axis] = np.bincount(tracks.track, agrees * proposed_m[:, axis], minlength=tracks.count)
    xyz_m /= np.maximum(np.bincount(tracks.track, agrees, minlength=tracks.count), 1)[:, None]
    inlier, range_m, bearing_rad = _classify(tracks, pose, xyz_m)
    return TruePoints(xyz_m, known, range_m, bearing_rad, inlier & known[tracks.track])


def measure_noise(tracks: Tracks, truth: TruePoints) -> FloatArray | None:
    """Estimate the standard deviations (2,) of range_m and bearing_rad of the inliers.

    A track's point is the mean of its n observations, so that only (n - 1) / n of their variance remains (Bessel's
    correction). None where no track has two inliers.
    """
    views = np.bincount(tracks.track[truth.inlier], minlength=tracks.count)
    chosen = truth.inlier & (views >= 2)[tracks.track]
    if not chosen.any():
        return None
    degrees_of_freedom = float(np.sum(views[views >= 2] - 1))
    range_error_m = (tracks.range_m - truth.range_m)[chosen]
    bearing_error_rad = angle_difference(tracks.bearing_rad, truth.bearing_rad)[chosen]
    return np.sqrt(np.array([np.sum(range_error_m**2), np.sum(bearing_error_rad**2)]) / degrees_of_freedom)


def _look_up_elevations(
    tracks: Tracks, sonar: SonarModel, read_truth: Callable[[int], FrameTruth]
) -> tuple[FloatArray, BoolArray]:
    """Return the true elevation at each observation's pixel (O,), zero without one, and (O,) whether there is one."""
    row_column = np.stack([sonar.row_at_range(tracks.range_m), sonar.column_at_bearing(tracks.bearing_rad)], axis=1)
    elevation_rad, echoes = np.zeros(len(tracks)), np.zeros(len(tracks), dtype=bool)
    for frame, here in enumerate(tracks.by_frame(int(tracks.frame.max(initial=0)) + 1)):
        if len(here):
            found = look_up_elevation(row_column[here], read_truth(frame).elevation_rad)
            elevation_rad[here], echoes[here] = found
    return elevation_rad, echoes


def _choose_proposals(
    tracks: Tracks, pose: FloatArray, proposed_m: FloatArray, echoes: BoolArray
) -> tuple[IntArray, BoolArray]:
    """Return the observation of each track with the smallest truncated cost (T,), and whether there is one (T,)."""
    first = np.searchsorted(tracks.track, np.arange(tracks.count))
    length = np.diff(first, append=len(tracks))
    best, best_cost = first.copy(), np.full(tracks.count, np.inf)
    candidate_count = min(MAX_CANDIDATES, int(length.max(initial=0)))
    for number in range(candidate_count):
        candidate = first + number * length // candidate_count
        _, range_m, bearing_rad = _classify(tracks, pose, proposed_m[candidate])
        square = ((range_m - tracks.range_m) / TRUTH_TOLERANCE.range_m) ** 2
        square += (angle_difference(bearing_rad, tracks.bearing_rad) / TRUTH_TOLERANCE.bearing_rad) ** 2
        cost = np.bincount(tracks.track, np.minimum(square, 1.0), minlength=tracks.count)
        cost[~echoes[candidate]] = np.inf
        better = cost < best_cost
        best[better], best_cost[better] = candidate[better], cost[better]
    return best, np.isfinite(best_cost)


def _classify(tracks: Tracks, pose: FloatArray, xyz_m: FloatArray) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Project (T, 3) points to the observations: (O,) whether within the tolerance, (O,) range_m, (O,) bearing_rad."""
    range_m, bearing_rad, _ = project(transform(pose, xyz_m[tracks.track]))
    bearing_error_rad = wrap_angle(bearing_rad - tracks.bearing_rad)
    inlier = np.abs(range_m - tracks.range_m) <= TRUTH_TOLERANCE.range_m
    inlier &= np.abs(bearing_error_rad) <= TRUTH_TOLERANCE.bearing_rad
    return np.asarray(inlier), range_m, bearing_rad
