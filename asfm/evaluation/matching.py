"""Precision and recall of matches against a simulation's truth, and the errors of the places that they join."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from asfm.evaluation.trajectory import summarise
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import back_project, project
from asfm.types import BoolArray, FloatArray, Keypoints, Matches

RANGE_TOLERANCE_M = 0.10
BEARING_TOLERANCE_RAD = float(np.radians(1.5))
"""A match is right when its second keypoint lies this close to where the first one's point truly is."""
REACH_PX = 2.0
"""A keypoint sits beside its echo as often as on it: the nearest pixel with an elevation this close counts."""


@dataclass(frozen=True)
class TruePositions:
    """Where the points of one frame's keypoints truly are in another frame."""

    range_m: FloatArray
    """(K,), zero where unknown."""
    bearing_rad: FloatArray
    """(K,), zero where unknown."""
    known: BoolArray
    """(K,) false where nothing echoes near the keypoint: it is noise, and no match of it is right."""


@dataclass(frozen=True)
class MatchQuality:
    """What truth says of the matches of one pair of frames, or of many."""

    matches: int
    right: int
    possible: int
    """Keypoints of the first frame that have a right partner in the second."""
    found: int
    """Those of them that a right match joins."""
    range_error_m: FloatArray
    """(right,) seen minus true, both keypoints' errors together."""
    bearing_error_rad: FloatArray
    """(right,) seen minus true, both keypoints' errors together."""

    @property
    def precision(self) -> float | None:
        """Right matches in all matches; None where there are none."""
        return self.right / self.matches if self.matches else None

    @property
    def recall(self) -> float | None:
        """Found keypoints in all possible ones; None where there are none."""
        return self.found / self.possible if self.possible else None


def look_up_elevation(
    row_column: FloatArray, elevation_rad: FloatArray, reach_px: float = REACH_PX
) -> tuple[FloatArray, BoolArray]:
    """Take the elevation of the nearest pixel that has one.

    Args:
        row_column: (K, 2) fractional, pixel centres at +0.5.
        elevation_rad: (ranges, beams), NaN where nothing echoes.
        reach_px: farthest centre of a pixel that counts.

    Returns:
        (K,) elevation, zero where unknown, and (K,) whether it is known.
    """
    reach = int(np.ceil(reach_px))
    offset = np.indices((2 * reach + 1, 2 * reach + 1)).reshape(2, -1).T - reach
    pixel = np.floor(row_column).astype(int)[:, None] + offset
    distance_px = np.linalg.norm(pixel + 0.5 - row_column[:, None], axis=-1)
    inside = np.all((pixel >= 0) & (pixel < elevation_rad.shape), axis=-1)
    row, column = np.moveaxis(np.where(inside[..., None], pixel, 0), -1, 0)
    candidate_rad = elevation_rad[row, column].astype(float)
    distance_px[~inside | ~np.isfinite(candidate_rad) | (distance_px > reach_px)] = np.inf
    keypoint, nearest = np.arange(len(pixel)), np.argmin(distance_px, axis=1)
    known = np.isfinite(distance_px[keypoint, nearest])
    return np.where(known, candidate_rad[keypoint, nearest], 0.0), known


def find_true_positions(
    keypoints: Keypoints, elevation_rad: FloatArray, sonar_b_from_sonar_a: FloatArray
) -> TruePositions:
    """Carry the keypoints of frame a, with the true (ranges, beams) elevation of frame a, into frame b."""
    elevation, known = look_up_elevation(keypoints.row_column, elevation_rad)
    in_a_m = back_project(keypoints.range_m, keypoints.bearing_rad, elevation)
    range_m, bearing_rad, _ = project(transform(sonar_b_from_sonar_a, in_a_m))
    return TruePositions(np.where(known, range_m, 0.0), np.where(known, bearing_rad, 0.0), known)


def judge_matches(
    truth: TruePositions,
    keypoints_b: Keypoints,
    matches: Matches,
    range_tolerance_m: float = RANGE_TOLERANCE_M,
    bearing_tolerance_rad: float = BEARING_TOLERANCE_RAD,
) -> BoolArray:
    """Tell which of the (M,) matches are right: both range and bearing lie within their tolerance of the truth."""
    a, b = matches.index[:, 0], matches.index[:, 1]
    range_error_m = keypoints_b.range_m[b] - truth.range_m[a]
    bearing_error_rad = _wrap(keypoints_b.bearing_rad[b] - truth.bearing_rad[a])
    near = (np.abs(range_error_m) <= range_tolerance_m) & (np.abs(bearing_error_rad) <= bearing_tolerance_rad)
    return np.asarray(near & truth.known[a])


def evaluate_matches(
    keypoints_a: Keypoints,
    keypoints_b: Keypoints,
    matches: Matches,
    elevation_rad: FloatArray,
    world_from_sonar_a: FloatArray,
    world_from_sonar_b: FloatArray,
    range_tolerance_m: float = RANGE_TOLERANCE_M,
    bearing_tolerance_rad: float = BEARING_TOLERANCE_RAD,
) -> MatchQuality:
    """Judge the matches of a pair of frames by the true elevation (ranges, beams) of frame a and both true poses."""
    truth = find_true_positions(keypoints_a, elevation_rad, invert(world_from_sonar_b) @ world_from_sonar_a)
    right = judge_matches(truth, keypoints_b, matches, range_tolerance_m, bearing_tolerance_rad)
    near = np.abs(keypoints_b.range_m - truth.range_m[:, None]) <= range_tolerance_m
    near &= np.abs(_wrap(keypoints_b.bearing_rad - truth.bearing_rad[:, None])) <= bearing_tolerance_rad
    a, b = matches.index[right].T
    return MatchQuality(
        matches=len(matches),
        right=int(right.sum()),
        possible=int((near.any(axis=1) & truth.known).sum()),
        found=len(np.unique(a)),
        range_error_m=keypoints_b.range_m[b] - truth.range_m[a],
        bearing_error_rad=_wrap(keypoints_b.bearing_rad[b] - truth.bearing_rad[a]),
    )


def pool_matches(qualities: Iterable[MatchQuality]) -> MatchQuality:
    """Add up the counts and join the errors of many pairs of frames."""
    parts = list(qualities)
    return MatchQuality(
        matches=sum(part.matches for part in parts),
        right=sum(part.right for part in parts),
        possible=sum(part.possible for part in parts),
        found=sum(part.found for part in parts),
        range_error_m=np.concatenate([np.zeros(0), *(part.range_error_m for part in parts)]),
        bearing_error_rad=np.concatenate([np.zeros(0), *(part.bearing_error_rad for part in parts)]),
    )


def describe_matches(quality: MatchQuality) -> tuple[tuple[str, float, str], ...]:
    """Give (name, value, unit) of all that is known; a measure without a single case is left out."""
    rows = [
        ("matches", float(quality.matches), "matches"),
        ("right matches", float(quality.right), "matches"),
        ("precision", None if quality.precision is None else 100 * quality.precision, "%"),
        ("recall", None if quality.recall is None else 100 * quality.recall, "%"),
    ]
    if quality.right:
        range_m, bearing_rad = summarise(np.abs(quality.range_error_m)), summarise(np.abs(quality.bearing_error_rad))
        rows += [
            ("range error of right matches, RMSE", range_m.rmse, "m"),
            ("range error of right matches, median", range_m.median, "m"),
            ("bearing error of right matches, RMSE", float(np.degrees(bearing_rad.rmse)), "deg"),
            ("bearing error of right matches, median", float(np.degrees(bearing_rad.median)), "deg"),
        ]
    return tuple((name, value, unit) for name, value, unit in rows if value is not None)


def _wrap(angle_rad: FloatArray) -> FloatArray:
    return np.remainder(angle_rad + np.pi, 2 * np.pi) - np.pi
