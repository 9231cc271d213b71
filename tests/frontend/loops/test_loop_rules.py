"""Rules of loop verification: thresholds of each test, gates, and coverage of the common field of view."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.frontend.loops.keypoint_tracks import KeypointTracks
from asfm.frontend.loops.loop_verification import (
    SUPPORTED_SHARE,
    _count_tried,
    _Pair,
    _reject_inconsistent,
    arc_inlier_ratio,
    verify_loop,
)
from asfm.frontend.matching.pair_matching import match_pairs
from asfm.geometry.poses import invert
from asfm.navigation.pose_prediction import PosePrediction
from asfm.types import Matches
from tests.frontend.loops.test_loop_verification import (
    CONFIG,
    NO_TRACKS,
    SONAR,
    Observation,
    make_random_scene,
    observe,
    pose_at,
    verify,
)
from tests.worlds import B_FROM_A, MATCHING_SONAR, make_frame_pair

MODULE = "asfm.frontend.loops.loop_verification"
STILL = np.stack([pose_at(0.0), pose_at(0.0)])


def revisit(seed: int = 0, yaw_rad: float = 0.0) -> list[Observation]:
    rng = np.random.default_rng(seed)
    scene = make_random_scene(rng)
    return [observe(scene, pose, rng) for pose in (pose_at(0.0), pose_at(0.0, yaw_rad))]


@pytest.mark.parametrize(
    ("share", "reason", "sure"),
    [
        (0.99 * SUPPORTED_SHARE, "chance", False),
        (1.01 * SUPPORTED_SHARE, "", False),
        (0.99, "", False),
        (1.0, "", True),
    ],
)
def test_false_alarms_decide_in_two_steps(
    monkeypatch: pytest.MonkeyPatch, share: float, reason: str, sure: bool
) -> None:
    """A third of the required logarithm keeps a pair that others support; the whole makes it sure."""
    monkeypatch.setattr(f"{MODULE}.log_false_alarms", lambda *_: share * CONFIG.loops.max_log_alarms)
    check, _ = verify(revisit(), STILL, 0.2, 0.03)
    assert (check.reason, check.sure) == (reason, sure)


@pytest.mark.parametrize(("share", "reason"), [(0.98, ""), (1.05, "competing motions")])
def test_competing_matches_are_counted_against_those_of_the_loop(
    monkeypatch: pytest.MonkeyPatch, share: float, reason: str
) -> None:
    limit = share * CONFIG.loops.max_rivals
    monkeypatch.setattr(f"{MODULE}._count_competing", lambda matches, *_: limit * len(matches))
    assert verify(revisit(), STILL, 0.2, 0.03)[0].reason == reason


@pytest.mark.parametrize("yaw_rad", [-0.3, 0.3])
def test_what_only_one_frame_can_see_does_not_count_for_coverage(yaw_rad: float) -> None:
    """The frames share three quarters of their views; within these all is matched."""
    check, correct = verify(revisit(0, yaw_rad), np.stack([pose_at(0.0), pose_at(0.0, yaw_rad)]), 0.2, 0.03)
    assert check.accepted and correct > 0.95


def test_matches_far_from_their_predicted_arcs_are_rejected() -> None:
    """They were found without the prediction, which excludes them."""
    observations = revisit(3)
    keypoints = [frame.keypoints for frame in observations]
    (matches,) = match_pairs([(0, 1)], keypoints, CONFIG, SONAR)
    assert len(matches) > 2 * CONFIG.loops.min_matches
    tracked = KeypointTracks(NO_TRACKS, keypoints, SONAR, CONFIG.noise, np.zeros(0, dtype=bool))
    for offset_m, reason in ((0.0, ""), (2.5, "matches")):
        predicted = PosePrediction(np.stack([pose_at(0.0), pose_at(offset_m)]), 0.002, 0.01)
        assert verify_loop(matches, keypoints, SONAR, predicted, tracked, CONFIG).reason == reason


def test_the_gate_of_arc_inliers_is_the_one_given() -> None:
    pair, sigma = make_frame_pair(count=60, wrong=0), np.array([0.01, 0.005])
    shifted = replace(pair.keypoints_b, range_m=pair.keypoints_b.range_m + 5 * sigma[0])
    poses, matches = np.stack([np.eye(4), invert(B_FROM_A)]), Matches(0, 1, pair.index, np.zeros(60))
    within = [
        arc_inlier_ratio(matches, [pair.keypoints_a, shifted], MATCHING_SONAR, poses, sigma, gate)
        for gate in (3.0, 5.1)
    ]
    assert within[0] < 0.5 and within[1] == 1.0


def test_motions_are_searched_among_all_matches_that_passed_the_descriptors() -> None:
    matches = Matches(0, 1, np.zeros((23, 2), dtype=np.int64), np.zeros(23))
    for count, name in ((7, "mutual"), (5, "planar"), (4, "ratio"), (3, "ssl")):
        matches = matches.reject(np.arange(len(matches)) < count, name)
    assert _count_tried(matches) == len(matches) + 5 + 3


def test_lengths_reject_what_an_uncertain_prediction_passes() -> None:
    """Every arc is within the gate; the wrong matches lie at distances from the others that the scene does not have."""
    pair = make_frame_pair(count=60, wrong=12)
    assert pair.arcs is not None
    matches = Matches(0, 1, pair.index, np.zeros(60))
    frames = _Pair(pair.keypoints_a, pair.keypoints_b, MATCHING_SONAR, CONFIG)
    left = _reject_inconsistent(matches, frames, pair.arcs, np.full((60, 2), 1e3))
    assert set(range(12, 60)) <= set(left.index[:, 0].tolist())
    assert left.count_rejected() == {"arc": 0, "length": 60 - len(left)} and len(left) < 55
