"""Loop verification: whether two frames far apart in time show the same place.

Each test rules out one kind of wrong loop: too few matches (chance), a second motion that fits as well (a repetitive
scene), matches that join landmarks seen apart in one frame, and matches in one corner only (two similar objects).
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
from asfm.frontend.matching.planar_ransac import find_planar_outliers, place_in_plane, planar_tolerance_m
from asfm.geometry.elevation_arcs import arc_box_candidates, arc_distances, arc_residuals
from asfm.geometry.feature_noise import relative_position_noise_m
from asfm.geometry.poses import invert
from asfm.geometry.sonar import SonarModel, back_project
from asfm.navigation.pose_prediction import PosePrediction
from asfm.types import BoolArray, FloatArray, Keypoints, Matches

COMPETING_MOTION_FILTERS = ("mutual", "planar", "ssl")
"""Filters of the matches of another motion: without the ratio test, which fails in scenes that repeat themselves."""
SUPPORTED_SHARE = 1 / 3
"""A pair that a sure one supports needs this share of the logarithm of false alarms: hysteresis (Canny 1986)."""
NEIGHBOURS = 8
"""Keypoints nearest to a match that count as covered by it."""
DESCRIPTOR_FILTERS = ("mutual", "ratio")
"""Filters that do not use positions: the motion is sought among the matches that pass them."""


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
        matches: those that passed the usual filters.
        keypoints: those of every frame; the pair's have their patches.
        sonar: gives aperture and noise.
        prediction: poses of the frames, with this pair's uncertainty.
        tracked: the tracks of the keypoints.
        config: sections ``loops``, ``matching`` and ``noise``.
    """
    settings = config.loops
    pair = _Pair(keypoints[matches.frame_a], keypoints[matches.frame_b], sonar, config)
    arcs, sigma = predict_arcs((matches.frame_a, matches.frame_b), pair.a, sonar, prediction, config.noise)
    rejected = sum(count for name, count in matches.count_rejected().items() if name not in DESCRIPTOR_FILTERS)
    tried = len(matches) + rejected
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
    tolerance_m = float(np.median(pair.tolerance_m()[matches.index[:, 1]]))
    return LoopCheck(matches, "", shift_m, tolerance_m, alarms <= settings.max_log_alarms)


def arc_inlier_ratio(
    matches: Matches,
    keypoints: Sequence[Keypoints],
    sonar: SonarModel,
    world_from_sonar: FloatArray,
    sigma: FloatArray,
    gate: float,
) -> float:
    """Return the share of a pair's matches within the gate of their elevation arcs under given poses.

    Args:
        matches: of one pair of frames.
        keypoints: those of every frame.
        sonar: gives the aperture.
        world_from_sonar: (N, 4, 4) poses.
        sigma: (2,) standard deviations of the difference in range_m and bearing_rad.
        gate: in sigmas.
    """
    if not len(matches):
        return 0.0
    b_from_a = invert(world_from_sonar[matches.frame_b]) @ world_from_sonar[matches.frame_a]
    of_a, of_b = matches.index.T
    pixel_a, pixel_b = keypoints[matches.frame_a].range_bearing[of_a], keypoints[matches.frame_b].range_bearing[of_b]
    residual = arc_residuals(sonar, np.broadcast_to(b_from_a, (len(matches), 4, 4)), pixel_a, pixel_b, sigma)
    return float(np.mean(residual <= gate))


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
    """Return the matches that agree on one planar motion, and that motion a_from_b (4, 4)."""
    if len(matches) < pair.config.loops.min_matches:
        return matches, np.eye(4)
    of_a, of_b = matches.index.T
    xy_a, xy_b = place_in_plane(pair.a, of_a), place_in_plane(pair.b, of_b)
    motion, outlier = find_planar_outliers(xy_a, xy_b, pair.tolerance_m()[of_b], matches.cost)
    return matches.reject(outlier, "planar"), motion


def _keypoints_at_motion(matches: Matches, pair: _Pair, motion: FloatArray) -> BoolArray:
    """Return which keypoints of b lie where the motion predicts each matched one of a: (Ka, Kb)."""
    of_a, (a, b) = matches.index[:, 0], (pair.a, pair.b)
    moved = place_in_plane(b, np.arange(len(b))) @ motion[:2, :2].T + motion[:2, 3]
    apart_m = np.linalg.norm(place_in_plane(a, of_a)[:, None] - moved, axis=2)
    found = np.zeros((len(a), len(b)), dtype=bool)
    found[of_a] = apart_m <= pair.tolerance_m()
    return found


def _count_competing(matches: Matches, pair: _Pair, elsewhere: BoolArray) -> int:
    """Count the matched keypoints of a that agree on another motion, with keypoints of b elsewhere."""
    allowed = np.zeros_like(elsewhere)
    allowed[matches.index[:, 0]] = elsewhere[matches.index[:, 0]]
    if not allowed.any():
        return 0
    competing = FramePair(pair.a, pair.b, find_nearest_neighbours(pair.a, pair.b, allowed), pair.sonar)
    frames = [(matches.frame_a, matches.frame_b)]
    return len(filter_pairs([competing], frames, COMPETING_MOTION_FILTERS, pair.config)[0])


def _coverage(matches: Matches, pair: _Pair, motion: FloatArray) -> float:
    """Return the share of the keypoints that both frames should see with a match nearby: of one place nearly all."""
    shares = []
    for own, other, which, other_from_own in (
        (pair.a, pair.b, matches.index[:, 0], np.linalg.inv(motion)),
        (pair.b, pair.a, matches.index[:, 1], motion),
    ):
        xy = place_in_plane(own, np.arange(len(own)))
        moved = xy @ other_from_own[:2, :2].T + other_from_own[:2, 3]
        range_m, bearing_rad = np.hypot(*moved.T), np.arctan2(moved[:, 1], moved[:, 0])
        common = (range_m >= other.range_m.min()) & (range_m <= other.range_m.max())
        common &= (bearing_rad >= other.bearing_rad.min()) & (bearing_rad <= other.bearing_rad.max())
        _, nearest = cKDTree(xy).query(xy[common], k=min(NEIGHBOURS, len(xy)))
        matched = np.zeros(len(xy), dtype=bool)
        matched[which] = True
        shares.append(float(np.mean(matched[nearest].any(axis=1))) if common.any() else 1.0)
    return min(shares)


def _prediction_error(matches: Matches, b: Keypoints, motion: FloatArray, prediction: PosePrediction) -> FloatArray:
    """Return the mean (2,) difference in the plane between the matches moved by the motion and by the prediction."""
    of_b = matches.index[:, 1]
    a_from_b = prediction.relative_pose(matches.frame_b, matches.frame_a)
    points = back_project(b.range_m[of_b], b.bearing_rad[of_b], 0.0)
    found = points @ motion[:3, :3].T + motion[:3, 3]
    return np.asarray((found - points @ a_from_b[:3, :3].T - a_from_b[:3, 3])[:, :2].mean(axis=0))
