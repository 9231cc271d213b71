"""Precision and recall of feature matches of frame pairs: against true elevations, or against elevation arcs.

A simulation knows each keypoint's elevation and so its exact position in the other frame. Where only true
poses are known, matches are evaluated by their elevation arcs (:mod:`asfm.evaluation.arc_consistency`).
"""

from collections import abc, defaultdict
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from asfm.evaluation.arc_consistency import Tolerance, find_arc_inliers
from asfm.evaluation.true_positions import TRUTH_TOLERANCE, TruePositions, find_true_positions
from asfm.geometry.poses import invert, wrap_angle
from asfm.geometry.sonar import SonarModel
from asfm.types import BoolArray, FloatArray, FrameTruth, Keypoints, Matches

SEARCH_MARGIN = 1e-9
"""Widening of the search for partners, so that rounding excludes none at the tolerance itself."""


@dataclass(frozen=True)
class MatchQuality:
    """Correct matches of one frame pair, or of many."""

    matches: int
    possible: int
    """Keypoints of the first frame with a correct partner among the keypoints of the second."""
    recalled: int
    """Those of them with a correct match."""
    range_error_m: FloatArray
    """(C,) of the correct matches, detected minus true; the localisation errors of both keypoints add up."""
    bearing_error_rad: FloatArray
    """(C,) of the correct matches, detected minus true."""

    @property
    def correct(self) -> int:
        """Number of correct matches."""
        return len(self.range_error_m)

    @property
    def precision(self) -> float | None:
        """Correct matches over all matches; None without matches."""
        return self.correct / self.matches if self.matches else None

    @property
    def recall(self) -> float | None:
        """Recalled keypoints over all that could be matched correctly; None where none could."""
        return self.recalled / self.possible if self.possible else None


def evaluate_pair(
    truth: TruePositions, keypoints_b: Keypoints, matches: Matches, tolerance: Tolerance = TRUTH_TOLERANCE
) -> MatchQuality:
    """Evaluate the matches of one frame pair.

    Args:
        truth: (K) true positions of frame a's keypoints in frame b.
        keypoints_b: of frame b.
        matches: (M) of frames a and b.
        tolerance: largest errors of a correct match in range and bearing, both inclusive.
    """
    range_error_m, bearing_error_rad = _find_errors(truth, keypoints_b, matches)
    correct = find_correct(truth, keypoints_b, matches, tolerance)
    possible = _find_possible(truth, keypoints_b, tolerance)
    return MatchQuality(
        matches=len(matches),
        possible=int(possible.sum()),
        recalled=len(np.unique(matches.index[correct, 0])),
        range_error_m=range_error_m[correct],
        bearing_error_rad=bearing_error_rad[correct],
    )


def find_correct(
    truth: TruePositions, keypoints_b: Keypoints, matches: Matches, tolerance: Tolerance = TRUTH_TOLERANCE
) -> BoolArray:
    """Return which of the (M,) matches of one frame pair are correct. See :func:`evaluate_pair`."""
    within = _within(*_find_errors(truth, keypoints_b, matches), tolerance)
    return np.asarray(within & truth.known[matches.index[:, 0]])


def pool_pairs(qualities: abc.Iterable[MatchQuality]) -> MatchQuality:
    """Add up the counts and concatenate the errors of many frame pairs."""
    parts = list(qualities)
    return MatchQuality(
        matches=sum(part.matches for part in parts),
        possible=sum(part.possible for part in parts),
        recalled=sum(part.recalled for part in parts),
        range_error_m=np.concatenate([np.zeros(0), *(part.range_error_m for part in parts)]),
        bearing_error_rad=np.concatenate([np.zeros(0), *(part.bearing_error_rad for part in parts)]),
    )


def evaluate_pairs_by_truth(
    keypoints: abc.Sequence[Keypoints],
    matches: abc.Iterable[Matches],
    world_from_sonar: FloatArray,
    read_truth: abc.Callable[[int], FrameTruth],
) -> abc.Iterator[tuple[Matches, MatchQuality]]:
    """Evaluate each frame pair by the true elevations of a simulation.

    Args:
        keypoints: one set a frame.
        matches: any frame pairs, frame_a before frame_b.
        world_from_sonar: (N, 4, 4) true poses of the frames.
        read_truth: returns the truth of a frame; called once for each frame_a.

    Yields:
        The matches of each frame pair and their quality, by rising frame_a.

    Raises:
        AsfmError: the truth of a frame cannot be read.
    """
    for frame_a, pairs in groupby(sorted(matches, key=_frame_a), key=_frame_a):
        elevation_rad = read_truth(frame_a).elevation_rad
        for pair in pairs:
            b_from_a = invert(world_from_sonar[pair.frame_b]) @ world_from_sonar[frame_a]
            truth = find_true_positions(keypoints[frame_a], elevation_rad, b_from_a)
            yield pair, evaluate_pair(truth, keypoints[pair.frame_b], pair)


def evaluate_by_truth(
    keypoints: abc.Sequence[Keypoints],
    matches: abc.Iterable[Matches],
    world_from_sonar: FloatArray,
    read_truth: abc.Callable[[int], FrameTruth],
) -> dict[int, MatchQuality]:
    """Evaluate matches by the true elevations of a simulation, as :func:`evaluate_pairs_by_truth`.

    Returns:
        The pooled quality of each frame gap that occurs, in rising order.

    Raises:
        AsfmError: the truth of a frame cannot be read.
    """
    found: dict[int, list[MatchQuality]] = defaultdict(list)
    for pair, quality in evaluate_pairs_by_truth(keypoints, matches, world_from_sonar, read_truth):
        found[pair.frame_b - pair.frame_a].append(quality)
    return {gap: pool_pairs(found[gap]) for gap in sorted(found)}


def evaluate_pair_by_arcs(
    keypoints: abc.Sequence[Keypoints], pair: Matches, world_from_sonar: FloatArray, sonar: SonarModel
) -> BoolArray:
    """Return which of the (M,) matches of a frame pair lie on their elevation arc under true poses (N, 4, 4)."""
    b_from_a = invert(world_from_sonar[pair.frame_b]) @ world_from_sonar[pair.frame_a]
    pixel_a, pixel_b = (
        keypoints[frame].range_bearing[index]
        for frame, index in zip((pair.frame_a, pair.frame_b), pair.index.T, strict=True)
    )
    return find_arc_inliers(pixel_a, pixel_b, b_from_a, sonar)


def evaluate_by_arcs(
    keypoints: abc.Sequence[Keypoints], matches: abc.Iterable[Matches], world_from_sonar: FloatArray, sonar: SonarModel
) -> dict[int, BoolArray]:
    """Evaluate matches by their elevation arcs under true poses.

    Args:
        keypoints: one set a frame.
        matches: any frame pairs, frame_a before frame_b.
        world_from_sonar: (N, 4, 4) true poses of the frames.
        sonar: elevation aperture.

    Returns:
        For each frame gap that occurs, in rising order, which of all its (M,) matches lie on their arc.
    """
    found: dict[int, list[BoolArray]] = defaultdict(list)
    for pair in matches:
        inlier = evaluate_pair_by_arcs(keypoints, pair, world_from_sonar, sonar)
        found[pair.frame_b - pair.frame_a].append(inlier)
    return {gap: np.concatenate(found[gap]) for gap in sorted(found)}


def _frame_a(matches: Matches) -> int:
    return matches.frame_a


def _find_errors(truth: TruePositions, keypoints_b: Keypoints, matches: Matches) -> tuple[FloatArray, FloatArray]:
    """Return detected minus true range_m and bearing_rad (M,) of the second keypoints of matches."""
    a, b = matches.index[:, 0], matches.index[:, 1]
    range_error_m = keypoints_b.range_m[b] - truth.range_m[a]
    return range_error_m, wrap_angle(keypoints_b.bearing_rad[b] - truth.bearing_rad[a])


def _find_possible(truth: TruePositions, keypoints_b: Keypoints, tolerance: Tolerance) -> BoolArray:
    """Return which of frame a's (K,) keypoints have a correct partner among those of frame b.

    Only partners near in range are compared, so that the time does not grow with the product of both numbers.
    """
    order = np.argsort(keypoints_b.range_m)
    sorted_m, reach_m = keypoints_b.range_m[order], tolerance.range_m * (1 + SEARCH_MARGIN) + SEARCH_MARGIN
    begin = np.searchsorted(sorted_m, truth.range_m - reach_m)
    count = np.searchsorted(sorted_m, truth.range_m + reach_m) - begin
    a = np.repeat(np.arange(len(count)), count)
    b = order[np.arange(len(a)) + np.repeat(begin - np.cumsum(count) + count, count)]
    bearing_error_rad = wrap_angle(keypoints_b.bearing_rad[b] - truth.bearing_rad[a])
    near = _within(keypoints_b.range_m[b] - truth.range_m[a], bearing_error_rad, tolerance)
    return np.asarray((np.bincount(a[near], minlength=len(count)) > 0) & truth.known)


def _within(range_error_m: FloatArray, bearing_error_rad: FloatArray, tolerance: Tolerance) -> BoolArray:
    in_range = np.abs(range_error_m) <= tolerance.range_m
    return np.asarray(in_range & (np.abs(bearing_error_rad) <= tolerance.bearing_rad))
