"""Loop closure: propose pairs of frames, match and verify them, and close the loops that are consistent."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from asfm.backend.estimation.solution import Solution
from asfm.backend.loops.loop_candidates import LoopPair, LoopSearch, choose_pairs, find_neighbours, search_loops
from asfm.backend.loops.loop_closure import close_loops
from asfm.config import Config
from asfm.frontend.features.keypoints import cut_keypoint_patches
from asfm.frontend.loops.keypoint_tracks import KeypointTracks
from asfm.frontend.loops.loop_check import LoopCheck, are_mutually_consistent
from asfm.frontend.loops.loop_verification import arc_inlier_ratio, verify_loop
from asfm.frontend.loops.place_descriptor import describe_place, place_similarity
from asfm.frontend.matching.pair_matching import match_pairs
from asfm.frontend.matching.patch_alignment import align_matches
from asfm.geometry.feature_noise import difference_sigma, feature_sigma
from asfm.navigation.pose_prediction import PosePrediction
from asfm.sequence import Sequence
from asfm.stages import StageReport
from asfm.types import FloatArray, Keypoints, Matches, Tracks

CheckedPair = tuple[LoopPair, LoopCheck]

LOOP_COST_OFFSET = 1.0
"""Added to the cost of a loop's matches, so that tracks are built from the matches within the window first."""
MIN_INLIER_RATIO = 0.5
"""Share of a loop's matches that must be inliers of their elevation arcs once all loops are closed."""
MIN_CONSISTENT_SHARE = 0.8
"""Share of the loops that must be consistent: with fewer the scene is repetitive, and all loops are rejected."""


@dataclass(frozen=True)
class Closure:
    """Accepted loops, and the poses after closing them."""

    world_from_vehicle: FloatArray
    """(N, 4, 4); unchanged where no loop was accepted or the poses agree with all of them."""
    matches: list[Matches]
    """Those of the accepted loops."""


@dataclass
class _LoopFrames:
    """Frames of loop candidates: images are read again only where a candidate needs them, each once."""

    sequence: Sequence
    keypoints: list[Keypoints]
    """Of every frame; those of loaded frames have patches."""
    descriptors: dict[int, FloatArray]
    """Place descriptors by frame, of loaded frames."""
    config: Config

    def load(self, index: int) -> FloatArray:
        """Return the place descriptor of a frame, (rings, sectors), and cut the patches of its keypoints."""
        if index not in self.descriptors:
            frame = self.sequence.read_frame(index)
            self.descriptors[index] = describe_place(frame, self.sequence.sonar)
            self.keypoints[index] = cut_keypoint_patches(frame, self.keypoints[index], self.sequence.sonar, self.config)
        return self.descriptors[index]


def find_loops(
    sequence: Sequence, keypoints: list[Keypoints], solution: Solution, config: Config, report: StageReport
) -> Closure:
    """Find loops under the poses of a solution, and close them.

    Args:
        sequence: gives images, sonar and lever arm.
        keypoints: those of every frame, without patches.
        solution: poses, tracks and graph.
        config: sections ``loops``, ``matching``, ``noise`` and ``backend``.
        report: receives the numbers of pairs checked, loops accepted and rejected.

    Raises:
        AsfmError: a frame cannot be read again.
    """
    poses, window = solution.bundle.world_from_vehicle, config.matching.max_gap
    search = search_loops(solution, sequence, config.loops, window)
    chosen = choose_pairs(search, config.loops, window)
    frames = _LoopFrames(sequence, list(keypoints), {}, config)
    keypoint_tracks = KeypointTracks(solution.tracks, keypoints, sequence.sonar, config.noise, solution.observed)
    world_from_sonar = poses @ sequence.vehicle_from_sonar
    checked = _check_pairs(chosen, frames, world_from_sonar, keypoint_tracks)
    neighbours = _unconfirmed_neighbours(search, checked, window)
    checked += _check_pairs(neighbours, frames, world_from_sonar, keypoint_tracks)
    confirmed = _confirmed_pairs(checked, window)
    poses, loops = _close_consistent([check.matches for _, check in confirmed], frames, solution, keypoint_tracks)
    report.counts = {
        "pairs looked at": len(chosen) + len(neighbours),
        "loops": len(loops),
        "matches": sum(len(match) for match in loops),
        **_count_rejections(checked, confirmed, len(confirmed) - len(loops)),
    }
    return Closure(poses, [replace(match, cost=match.cost + LOOP_COST_OFFSET) for match in loops])


def _check_pairs(
    pairs: Iterable[LoopPair], frames: _LoopFrames, world_from_sonar: FloatArray, keypoint_tracks: KeypointTracks
) -> list[CheckedPair]:
    """Match and verify the pairs with similar place descriptors; (N, 4, 4) poses predict the motion."""
    min_similarity = frames.config.loops.min_similarity
    return [
        (pair, _check_pair(pair, frames, world_from_sonar, keypoint_tracks))
        for pair in pairs
        if place_similarity(frames.load(pair.frame_a), frames.load(pair.frame_b)) >= min_similarity
    ]


def _check_pair(
    pair: LoopPair, frames: _LoopFrames, world_from_sonar: FloatArray, keypoint_tracks: KeypointTracks
) -> LoopCheck:
    """Match a pair under the predicted motion, and verify the loop."""
    sonar, config = frames.sequence.sonar, frames.config
    root = float(np.sqrt(pair.frame_b - pair.frame_a))
    predicted = PosePrediction(world_from_sonar, pair.bearing_sigma_rad / root, pair.range_sigma_m / root)
    matches = match_pairs([(pair.frame_a, pair.frame_b)], frames.keypoints, config, sonar, predicted)
    (aligned,) = align_matches(matches, frames.keypoints, sonar, config)
    return verify_loop(aligned, frames.keypoints, sonar, predicted, keypoint_tracks, config)


def _unconfirmed_neighbours(search: LoopSearch, checked: list[CheckedPair], window: int) -> list[LoopPair]:
    """Return the unchecked neighbours of the sure pairs that no other pair confirms."""
    confirmed, known = {pair for pair, _ in _confirmed_pairs(checked, window)}, {pair for pair, _ in checked}
    unconfirmed = [pair for pair, check in checked if check.sure and pair not in confirmed]
    neighbours = [other for pair in unconfirmed for other in find_neighbours(search, pair)]
    return [pair for pair in dict.fromkeys(neighbours) if pair not in known]


def _confirmed_pairs(checked: list[CheckedPair], window: int) -> list[CheckedPair]:
    """Return the accepted pairs that another accepted pair, near in both frames, is consistent with; one is sure."""
    accepted = [(pair, check) for pair, check in checked if check.accepted]
    return [one for one in accepted if any(are_mutually_consistent(one[1], other[1], 2 * window) for other in accepted)]


def _close_consistent(
    loops: list[Matches], frames: _LoopFrames, solution: Solution, keypoint_tracks: KeypointTracks
) -> tuple[FloatArray, list[Matches]]:
    """Close the loops, reject those that the closed trajectory contradicts, and close the others again.

    Where many contradict each other all are rejected, because none can be trusted. Where the poses agree with all loops
    before closure the poses stay, and only the matches are used.

    Returns:
        (N, 4, 4) world_from_vehicle, and the matches of the consistent loops.
    """
    poses, sequence, config = solution.bundle.world_from_vehicle, frames.sequence, frames.config
    correlation = config.backend.track_correlation
    sigma = feature_sigma(sequence.sonar, config.noise)
    while loops:
        observations = loop_observations(loops, keypoint_tracks)
        closed = close_loops(solution.bundle, observations, sigma, sequence.vehicle_from_sonar, correlation)
        consistent = _find_consistent(loops, closed, frames)
        if all(consistent):
            return poses if all(_find_consistent(loops, poses, frames)) else closed, loops
        if sum(consistent) < MIN_CONSISTENT_SHARE * len(consistent):
            return poses, []
        loops = [match for match, kept in zip(loops, consistent, strict=True) if kept]
    return poses, loops


def _find_consistent(loops: list[Matches], world_from_vehicle: FloatArray, frames: _LoopFrames) -> list[bool]:
    """Return which loops are consistent with (N, 4, 4) poses."""
    sonar, config = frames.sequence.sonar, frames.config
    world_from_sonar = world_from_vehicle @ frames.sequence.vehicle_from_sonar
    sigma, gate = difference_sigma(sonar, config.noise), config.matching.arc_gate
    return [
        arc_inlier_ratio(match, frames.keypoints, sonar, world_from_sonar, sigma, gate) >= MIN_INLIER_RATIO
        for match in loops
    ]


def loop_observations(loops: list[Matches], keypoint_tracks: KeypointTracks) -> Tracks:
    """Convert matches into observations of either frame's landmark by the other frame, without duplicates.

    Args:
        loops: matches of the accepted loops.
        keypoint_tracks: the track of each keypoint, and the keypoints of every frame.

    Returns:
        Observations whose tracks are those of the solution, sorted.
    """
    rows = []
    for match in loops:
        for frame, other, (own, theirs) in (
            (match.frame_a, match.frame_b, match.index.T),
            (match.frame_b, match.frame_a, match.index.T[::-1]),
        ):
            track, seen = keypoint_tracks.find(other, theirs), keypoint_tracks.keypoints[frame]
            same = track == keypoint_tracks.find(frame, own)
            row = np.stack([track, np.full(len(own), frame), seen.range_m[own], seen.bearing_rad[own]], axis=1)
            rows.append(row[(track >= 0) & ~same])
    table = np.unique(np.concatenate(rows), axis=0)
    return Tracks(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2], table[:, 3])


def _count_rejections(checked: list[CheckedPair], confirmed: list[CheckedPair], contradicted: int) -> dict[str, float]:
    """Count the rejected pairs by reason."""
    reasons = [check.reason for _, check in checked if not check.accepted]
    unconfirmed = len(checked) - len(reasons) - len(confirmed)
    reasons += ["standing alone"] * unconfirmed + ["contradiction"] * contradicted
    return {f"rejected for {name}": reasons.count(name) for name in dict.fromkeys(reasons)}
