"""Verification of a loop: whether two frames far apart in time truly show the same place.

Every test is against one way of being wrong: too few matches (chance), a second motion that fits as well (a scene that
repeats itself), matches that join what one frame sees apart, or in one corner only (two things that look alike).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import binom

from asfm.config import Config
from asfm.frontend.loops.keypoint_tracks import KeypointTracks
from asfm.frontend.matching.filters import FramePair, difference_sigma, filter_matches
from asfm.frontend.matching.nearest import find_nearest_neighbours
from asfm.frontend.matching.pairwise_consistency import find_distance_outliers
from asfm.frontend.matching.planar_ransac import find_planar_outliers, place_in_plane
from asfm.geometry.elevation_arcs import PosePrediction, arc_box_candidates, arc_distances, arc_residuals, project_arcs
from asfm.geometry.poses import invert
from asfm.geometry.sonar import SonarModel, back_project
from asfm.types import BoolArray, FloatArray, Keypoints, Matches

COMPETING_MOTION_FILTERS = ("mutual", "planar", "ssl")
"""What judges the matches of another motion: not the ratio, for in a scene that repeats itself no nearest is clear."""
UNSURE = 1 / 3
"""A pair that a sure one supports may have this share of the logarithm of false alarms: two thresholds, as edges have
in images (Canny 1986)."""
NEARBY = 8
"""A match is nearby when it is among so many keypoints nearest to one: as far as they lie apart themselves."""
OF_DESCRIPTORS = ("mutual", "ratio")
"""Filters that do not ask where a match lies: those that they let pass are what a motion is sought among."""


@dataclass(frozen=True)
class LoopCheck:
    """What became of a pair of frames."""

    matches: Matches
    """Those that agree on one motion, when the pair is accepted and when not."""
    reason: str
    """Why the pair is rejected; empty where it is accepted."""
    shift_m: FloatArray
    """(2,) by which frame a's plane says that the prediction is wrong, in the mean over the matches."""
    tolerance_m: float
    """How surely that is known."""
    sure: bool = False
    """Whether the pair is beyond chance by itself; others need a sure one that supports them."""

    @property
    def accepted(self) -> bool:
        """Whether all tests were passed."""
        return not self.reason


def verify_loop(
    matches: Matches,
    keypoints: Sequence[Keypoints],
    sonar: SonarModel,
    predicted: PosePrediction,
    tracked: KeypointTracks,
    config: Config,
) -> LoopCheck:
    """Judge the matches of one pair of frames.

    Args:
        matches: that the usual filters let pass.
        keypoints: those of every frame; the pair's have their patches.
        sonar: the aperture and the noise.
        predicted: where the frames are, with this pair's uncertainty.
        tracked: which landmark each keypoint shows, as far as known.
        config: section ``loops``, and those of matching and noise.
    """
    settings, a, b = config.loops, keypoints[matches.frame_a], keypoints[matches.frame_b]
    sigma = predicted.predicted_sigma(
        matches.frame_a, matches.frame_b, a.range_m, difference_sigma(sonar, config.noise)
    )
    arcs = project_arcs(sonar, predicted.relative_pose(matches.frame_a, matches.frame_b), _pixels(a))
    tried = len(matches) + sum(count for name, count in matches.count_rejected().items() if name not in OF_DESCRIPTORS)
    of_a, of_b = matches.index.T
    far = arc_distances(arcs[of_a], _pixels(b)[of_b], sigma[of_a]) > config.matching.arc_gate
    matches = matches.reject(far, "arc")
    matches = matches.reject(_find_other_lengths(matches, a, b, sonar, config), "length")
    if len(matches) < settings.min_matches:
        return _reject(matches, "matches")
    motion, disagrees = _fit_motion(matches, a, b, sonar, config)
    matches = matches.reject(disagrees, "planar")
    if len(matches) < settings.min_matches:
        return _reject(matches, "matches")
    near = arc_box_candidates(arcs, _pixels(b), config.matching.arc_gate * sigma)
    beside = _find_beside(matches, a, b, motion, _tolerance(b, sonar, config))
    alarms = log_false_alarms(tried, len(matches), beside)
    if alarms > settings.max_log_alarms * UNSURE:
        return _reject(matches, "chance")
    if tracked.share_conflicts(matches) > settings.max_conflicts:
        return _reject(matches, "conflicts")
    if _cover(matches, a, b, motion) < settings.min_coverage:
        return _reject(matches, "coverage")
    if _count_competing(matches, a, b, near & ~beside, sonar, config) > settings.max_rivals * len(matches):
        return _reject(matches, "competing motions")
    shift_m = _disagree(matches, b, motion, predicted)
    tolerance_m = float(np.median(_tolerance(b, sonar, config)[matches.index[:, 1]]))
    return LoopCheck(matches, "", shift_m, tolerance_m, alarms <= settings.max_log_alarms)


def log_false_alarms(tried: int, agree: int, beside: BoolArray) -> float:
    """Bound how many such agreements chance makes: log10 of motions tried times the binomial tail (a contrario).

    After Moisan and Stival (2004). In frames of two places, the nearest descriptor may lie anywhere. Of the matches
    tried, two define a motion; each other then agrees with it with the probability that a keypoint of frame b drawn by
    chance does, crowded as they are.

    Args:
        tried: matches that the motion was sought among.
        agree: those that agree with it.
        beside: (Ka, Kb) which keypoints of b lie where the motion says; rows of unmatched keypoints are all false.
    """
    rows = beside.any(axis=1)
    if agree <= 2 or not rows.any():
        return 0.0
    chance = float(np.clip(beside[rows].mean(), 1e-6, 1.0))
    motions = 0.5 * tried * (tried - 1)
    return float(np.log10(max(motions, 1.0)) + binom.logsf(agree - 3, tried - 2, chance) / np.log(10))


def are_mutually_consistent(first: LoopCheck, second: LoopCheck, window: int) -> bool:
    """Tell whether two pairs, close in both frames and one of them sure, say the same of the prediction's error."""
    a, b = (abs(getattr(first.matches, name) - getattr(second.matches, name)) for name in ("frame_a", "frame_b"))
    apart_m = float(np.linalg.norm(first.shift_m - second.shift_m))
    agree = apart_m <= 2 * max(first.tolerance_m, second.tolerance_m)
    return (first.sure or second.sure) and a + b > 0 and max(a, b) <= window and agree


def _reject(matches: Matches, reason: str) -> LoopCheck:
    return LoopCheck(matches, reason, np.zeros(2), 0.0)


def _pixels(keypoints: Keypoints) -> FloatArray:
    return np.stack([keypoints.range_m, keypoints.bearing_rad], axis=1)


def _tolerance(b: Keypoints, sonar: SonarModel, config: Config) -> FloatArray:
    """How far (Kb,) a keypoint may lie from where a motion in the plane puts it, as the planar filter has it."""
    sigma = difference_sigma(sonar, config.noise)
    noise_m = 2 * np.hypot(sigma[0], sigma[1] * b.range_m)
    return np.asarray(np.maximum(config.matching.planar_tolerance * b.range_m, noise_m))


def _find_other_lengths(matches: Matches, a: Keypoints, b: Keypoints, sonar: SonarModel, config: Config) -> BoolArray:
    of_a, of_b = matches.index.T
    sigma = difference_sigma(sonar, config.noise)
    slack_m = 2 * np.hypot(sigma[0], sigma[1] * b.range_m[of_b])
    return find_distance_outliers(_pixels(a)[of_a], _pixels(b)[of_b], sonar.elevation_aperture_rad, slack_m)


def _fit_motion(
    matches: Matches, a: Keypoints, b: Keypoints, sonar: SonarModel, config: Config
) -> tuple[FloatArray, BoolArray]:
    """Find the planar motion a_from_b (4, 4) that most matches agree with, and who does not."""
    of_a, of_b = matches.index.T
    tolerance_m = _tolerance(b, sonar, config)[of_b]
    return find_planar_outliers(place_in_plane(a, of_a), place_in_plane(b, of_b), tolerance_m, matches.cost)


def _find_beside(matches: Matches, a: Keypoints, b: Keypoints, motion: FloatArray, reach_m: FloatArray) -> BoolArray:
    """Tell which keypoints of b lie where the motion puts each matched one of a: (Ka, Kb)."""
    of_a = matches.index[:, 0]
    moved = place_in_plane(b, np.arange(len(b))) @ motion[:2, :2].T + motion[:2, 3]
    apart_m = np.linalg.norm(place_in_plane(a, of_a)[:, None] - moved, axis=2)
    beside = np.zeros((len(a), len(b)), dtype=bool)
    beside[of_a] = apart_m <= reach_m
    return beside


def _count_competing(
    matches: Matches, a: Keypoints, b: Keypoints, elsewhere: BoolArray, sonar: SonarModel, config: Config
) -> int:
    """Count how many of the matched keypoints of a agree on another motion, with keypoints of b elsewhere."""
    allowed = np.zeros_like(elsewhere)
    allowed[matches.index[:, 0]] = elsewhere[matches.index[:, 0]]
    if not allowed.any():
        return 0
    matching = config.matching.model_copy(update={"filters": COMPETING_MOTION_FILTERS})
    competing = FramePair(a, b, find_nearest_neighbours(a, b, allowed), sonar)
    return len(
        filter_matches(competing, matches.frame_a, matches.frame_b, config.model_copy(update={"matching": matching}))
    )


def _cover(matches: Matches, a: Keypoints, b: Keypoints, motion: FloatArray) -> float:
    """Tell which share of the keypoints that both frames should see has a match nearby.

    The same place agrees all over; of two places with one thing alike only that thing does.
    """
    shares = []
    for own, other, which, other_from_own in (
        (a, b, matches.index[:, 0], np.linalg.inv(motion)),
        (b, a, matches.index[:, 1], motion),
    ):
        xy = place_in_plane(own, np.arange(len(own)))
        moved = xy @ other_from_own[:2, :2].T + other_from_own[:2, 3]
        range_m, bearing_rad = np.hypot(*moved.T), np.arctan2(moved[:, 1], moved[:, 0])
        ends = (other.range_m, other.bearing_rad)
        common = (range_m >= ends[0].min()) & (range_m <= ends[0].max())
        common &= (bearing_rad >= ends[1].min()) & (bearing_rad <= ends[1].max())
        _, nearest = cKDTree(xy).query(xy[common], k=min(NEARBY, len(xy)))
        matched = np.zeros(len(xy), dtype=bool)
        matched[which] = True
        shares.append(float(np.mean(matched[nearest].any(axis=1))) if common.any() else 1.0)
    return min(shares)


def _disagree(matches: Matches, b: Keypoints, motion: FloatArray, predicted: PosePrediction) -> FloatArray:
    """Give the mean (2,) by which the motion in the plane moves the matches elsewhere than the prediction does."""
    of_b = matches.index[:, 1]
    a_from_b = predicted.relative_pose(matches.frame_b, matches.frame_a)
    points = back_project(b.range_m[of_b], b.bearing_rad[of_b], 0.0)
    found = points @ motion[:3, :3].T + motion[:3, 3]
    return np.asarray((found - points @ a_from_b[:3, :3].T - a_from_b[:3, 3])[:, :2].mean(axis=0))


def arc_inlier_ratio(
    matches: Matches,
    keypoints: Sequence[Keypoints],
    sonar: SonarModel,
    world_from_sonar: FloatArray,
    sigma: FloatArray,
    gate: float,
) -> float:
    """Tell which share of a pair's matches lies within the gate, in sigmas, of their elevation arcs under poses."""
    if not len(matches):
        return 0.0
    b_from_a = invert(world_from_sonar[matches.frame_b]) @ world_from_sonar[matches.frame_a]
    of_a, of_b = matches.index.T
    pixel_a, pixel_b = _pixels(keypoints[matches.frame_a])[of_a], _pixels(keypoints[matches.frame_b])[of_b]
    residual = arc_residuals(sonar, np.broadcast_to(b_from_a, (len(matches), 4, 4)), pixel_a, pixel_b, sigma)
    return float(np.mean(residual <= gate))
