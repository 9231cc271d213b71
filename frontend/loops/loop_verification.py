"""Loop verification: whether two frames far apart in time show the same place.

Each test rejects one kind of wrong loop: too few inliers (chance), another motion that fits as well (repetitive scene),
matches that join landmarks observed apart in one frame (conflicts), matches in one part of the image only (two similar
objects).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from asfm.config import Config
from asfm.frontend.loops.false_alarms import log_false_alarms
from asfm.frontend.loops.keypoint_tracks import KeypointTracks
from asfm.frontend.loops.loop_check import LoopCheck, reject_loop
from asfm.frontend.matching.filter_chain import filter_pairs
from asfm.frontend.matching.frame_pair import FramePair, predict_arcs
from asfm.frontend.matching.nearest import find_nearest_neighbours
from asfm.frontend.matching.pairwise_consistency import find_distance_outliers
from asfm.frontend.matching.planar_ransac import find_planar_outliers, planar_positions, planar_tolerance_m
from asfm.geometry.elevation_arcs import arc_box_candidates, arc_distances, arc_residuals
from asfm.geometry.feature_noise import relative_position_noise_m
from asfm.geometry.poses import invert
from asfm.geometry.sonar import SonarModel, back_project
from asfm.navigation.pose_prediction import PosePrediction
from asfm.types import BoolArray, FloatArray, Keypoints, Matches

COMPETING_MOTION_FILTERS = ("mutual", "planar", "ssl")
"""Filters of the matches of another motion: without the ratio test, which fails in repetitive scenes."""
SUPPORTED_SHARE = 1 / 3
"""Share of the log10 of false alarms required of a pair that a sure one supports: hysteresis (Canny 1986)."""
COVERAGE_NEIGHBOURS = 8
"""A keypoint counts as covered if one of this many nearest keypoints is matched."""
DESCRIPTOR_FILTERS = ("mutual", "ratio")
"""Filters that do not use positions: the matches that pass them are those the motion is searched among."""


@dataclass(frozen=True)
class _Pair:
    """The keypoints and settings of the two frames under test."""

    a: Keypoints
    b: Keypoints
    sonar: SonarModel
    config: Config

    def pixels(self, matches: Matches) -> tuple[FloatArray, FloatArray]:
        """Return (M, 2) range_m and bearing_rad of the matches in both frames."""
        of_a, of_b = matches.index.T
        return self.a.range_bearing[of_a], self.b.range_bearing[of_b]

    def tolerance_m(self) -> FloatArray:
        """Return the planar tolerances (Kb,) of frame b's keypoints."""
        return planar_tolerance_m(self.b.range_m, self.sonar, self.config)

    def median_tolerance_m(self, matches: Matches) -> float:
        """Return the median planar tolerance of the matches."""
        return float(np.median(self.tolerance_m()[matches.index[:, 1]]))


def verify_loop(
    matches: Matches,
    keypoints: Sequence[Keypoints],
    sonar: SonarModel,
    prediction: PosePrediction,
    tracked: KeypointTracks,
    config: Config,
) -> LoopCheck:
    """Verify the matches of one pair of frames.

    Args:
        matches: those that passed the filter chain.
        keypoints: those of every frame; the pair's have their patches.
        sonar: gives aperture and noise.
        prediction: poses of the frames, with this pair's uncertainty.
        tracked: the tracks of the keypoints.
        config: sections ``loops``, ``matching`` and ``noise``.

    Returns:
        The inliers of the estimated motion, and the test that rejected the pair, if any.
    """
    settings, pair = config.loops, _Pair(keypoints[matches.frame_a], keypoints[matches.frame_b], sonar, config)
    arcs, sigma = predict_arcs((matches.frame_a, matches.frame_b), pair.a, sonar, prediction, config.noise)
    tried = _count_tried(matches)
    matches, motion = _fit_motion(_reject_inconsistent(matches, pair, arcs, sigma), pair)
    if len(matches) < settings.min_matches:
        return reject_loop(matches, "matches")
    near = arc_box_candidates(arcs, pair.b.range_bearing, config.matching.arc_gate * sigma)
    at_motion = _keypoints_at_motion(matches, pair, motion)
    alarms = log_false_alarms(tried, len(matches), at_motion)
    if alarms > settings.max_log_alarms * SUPPORTED_SHARE:
        return reject_loop(matches, "chance")
    if tracked.share_conflicts(matches) > settings.max_conflicts:
        return reject_loop(matches, "conflicts")
    if _coverage(matches, pair, motion) < settings.min_coverage:
        return reject_loop(matches, "coverage")
    if _count_competing(matches, pair, near & ~at_motion) > settings.max_rivals * len(matches):
        return reject_loop(matches, "competing motions")
    shift_m = _prediction_error(matches, pair.b, motion, prediction)
    return LoopCheck(matches, "", shift_m, pair.median_tolerance_m(matches), alarms <= settings.max_log_alarms)


def arc_inlier_ratio(
    matches: Matches,
    keypoints: Sequence[Keypoints],
    sonar: SonarModel,
    world_from_sonar: FloatArray,
    sigma: FloatArray,
    gate: float,
) -> float:
    """Return the share of a pair's matches that lie near their elevation arcs under given poses.

    Args:
        matches: of one pair of frames.
        keypoints: those of every frame.
        sonar: gives the aperture.
        world_from_sonar: (N, 4, 4) poses.
        sigma: (2,) standard deviations of the difference in range_m and bearing_rad.
        gate: largest distance of an inlier, in sigmas.

    Returns:
        The share, 0..1; 0 without matches.
    """
    if not len(matches):
        return 0.0
    b_from_a = invert(world_from_sonar[matches.frame_b]) @ world_from_sonar[matches.frame_a]
    of_a, of_b = matches.index.T
    pixel_a, pixel_b = keypoints[matches.frame_a].range_bearing[of_a], keypoints[matches.frame_b].range_bearing[of_b]
    residual = arc_residuals(sonar, np.broadcast_to(b_from_a, (len(matches), 4, 4)), pixel_a, pixel_b, sigma)
    return float(np.mean(residual <= gate))


def _count_tried(matches: Matches) -> int:
    """Count the matches among which the motion is searched: all that passed the filters on descriptors."""
    rejected = sum(count for name, count in matches.count_rejected().items() if name not in DESCRIPTOR_FILTERS)
    return len(matches) + rejected


def _reject_inconsistent(matches: Matches, pair: _Pair, arcs: FloatArray, sigma: FloatArray) -> Matches:
    """Reject matches far from their predicted arcs, then those with inconsistent pairwise distances."""
    of_a = matches.index[:, 0]
    far = arc_distances(arcs[of_a], pair.pixels(matches)[1], sigma[of_a]) > pair.config.matching.arc_gate
    matches = matches.reject(far, "arc")
    pixel_a, pixel_b = pair.pixels(matches)
    slack_m = relative_position_noise_m(pixel_b[:, 0], pair.sonar, pair.config.noise)
    return matches.reject(
        find_distance_outliers(pixel_a, pixel_b, pair.sonar.elevation_aperture_rad, slack_m), "length"
    )


def _fit_motion(matches: Matches, pair: _Pair) -> tuple[Matches, FloatArray]:
    """Return the inliers of a planar motion, and that motion a_from_b (4, 4)."""
    if len(matches) < pair.config.loops.min_matches:
        return matches, np.eye(4)
    of_a, of_b = matches.index.T
    xy_a, xy_b = planar_positions(pair.a, of_a), planar_positions(pair.b, of_b)
    motion, outlier = find_planar_outliers(xy_a, xy_b, pair.tolerance_m()[of_b], matches.cost)
    return matches.reject(outlier, "planar"), motion


def _keypoints_at_motion(matches: Matches, pair: _Pair, motion: FloatArray) -> BoolArray:
    """Return which keypoints of b (Ka, Kb) lie where the motion predicts each matched keypoint of a."""
    of_a, (a, b) = matches.index[:, 0], (pair.a, pair.b)
    moved = planar_positions(b, np.arange(len(b))) @ motion[:2, :2].T + motion[:2, 3]
    distance_m = np.linalg.norm(planar_positions(a, of_a)[:, None] - moved, axis=2)
    at_motion = np.zeros((len(a), len(b)), dtype=bool)
    at_motion[of_a] = distance_m <= pair.tolerance_m()
    return at_motion


def _count_competing(matches: Matches, pair: _Pair, elsewhere: BoolArray) -> int:
    """Count the matched keypoints of a that agree on another motion, with keypoints of b that are elsewhere."""
    allowed = np.zeros_like(elsewhere)
    allowed[matches.index[:, 0]] = elsewhere[matches.index[:, 0]]
    if not allowed.any():
        return 0
    competing = FramePair(pair.a, pair.b, find_nearest_neighbours(pair.a, pair.b, allowed), pair.sonar)
    frames = [(matches.frame_a, matches.frame_b)]
    return len(filter_pairs([competing], frames, COMPETING_MOTION_FILTERS, pair.config)[0])


def _coverage(matches: Matches, pair: _Pair, motion: FloatArray) -> float:
    """Return the share (smaller of the two frames) of keypoints in the common field of view with a match nearby."""
    shares = []
    for own, other, which, other_from_own in (
        (pair.a, pair.b, matches.index[:, 0], np.linalg.inv(motion)),
        (pair.b, pair.a, matches.index[:, 1], motion),
    ):
        xy = planar_positions(own, np.arange(len(own)))
        moved = xy @ other_from_own[:2, :2].T + other_from_own[:2, 3]
        range_m, bearing_rad = np.hypot(*moved.T), np.arctan2(moved[:, 1], moved[:, 0])
        common = (range_m >= other.range_m.min()) & (range_m <= other.range_m.max())
        common &= (bearing_rad >= other.bearing_rad.min()) & (bearing_rad <= other.bearing_rad.max())
        _, nearest = cKDTree(xy).query(xy[common], k=min(COVERAGE_NEIGHBOURS, len(xy)))
        matched = np.zeros(len(xy), dtype=bool)
        matched[which] = True
        shares.append(float(np.mean(matched[nearest].any(axis=1))) if common.any() else 1.0)
    return min(shares)


def _prediction_error(matches: Matches, b: Keypoints, motion: FloatArray, prediction: PosePrediction) -> FloatArray:
    """Return the mean offset (2,) in the plane, in metres, from the predicted to the estimated positions of matches."""
    of_b = matches.index[:, 1]
    a_from_b = prediction.relative_pose(matches.frame_b, matches.frame_a)
    points = back_project(b.range_m[of_b], b.bearing_rad[of_b], 0.0)
    estimated = points @ motion[:3, :3].T + motion[:3, 3]
    return np.asarray((estimated - points @ a_from_b[:3, :3].T - a_from_b[:3, 3])[:, :2].mean(axis=0))
