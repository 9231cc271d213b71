"""Loop closure: propose pairs of frames, look at them again, verify what matches, close what stands."""

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

Judged = tuple[LoopPair, LoopCheck]

LOOP_COST_OFFSET = 1.0
"""Added to the cost of a loop's matches: tracks are built from the matches of the window first."""
MIN_INLIER_RATIO = 0.5
"""Share of a loop's matches that must lie near their arcs once all loops are closed."""
MIN_CONSISTENT_SHARE = 0.8
"""Share of the loops that must stand: where more contradict the others the scene repeats itself, and none is sure."""


@dataclass(frozen=True)
class Closure:
    """Loops that were found, and poses that agree with them."""

    world_from_vehicle: FloatArray
    """(N, 4, 4); those of before where there is no loop."""
    matches: list[Matches]
    """Of the accepted pairs of frames."""


@dataclass
class _LoopFrames:
    """Frames looked at again: each image is read once more, and only where a loop needs it."""

    sequence: Sequence
    keypoints: list[Keypoints]
    """Of every frame; those looked at have their patches."""
    descriptors: dict[int, FloatArray]
    config: Config

    def load(self, index: int) -> FloatArray:
        """Give the descriptor of a frame, and its keypoints their patches."""
        if index not in self.descriptors:
            frame = self.sequence.read_frame(index)
            self.descriptors[index] = describe_place(frame, self.sequence.sonar)
            self.keypoints[index] = cut_keypoint_patches(frame, self.keypoints[index], self.sequence.sonar, self.config)
        return self.descriptors[index]


def find_loops(
    sequence: Sequence, keypoints: list[Keypoints], solution: Solution, config: Config, report: StageReport
) -> Closure:
    """Find loops under the poses of a round, and close them.

    Args:
        keypoints: those of every frame, without patches.
        solution: poses, tracks and graph.
        report: told what was looked at and accepted.

    Raises:
        AsfmError: a frame cannot be read again.
    """
    poses, window = solution.bundle.world_from_vehicle, config.matching.max_gap
    search = search_loops(solution, sequence, config.loops, window)
    chosen = choose_pairs(search, config.loops, window)
    frames = _LoopFrames(sequence, list(keypoints), {}, config)
    tracked = KeypointTracks(solution.tracks, keypoints, sequence.sonar, config.noise, solution.observed)
    judged = _judge_pairs(chosen, frames, poses @ sequence.vehicle_from_sonar, tracked)
    beside = _list_neighbours(search, judged, window)
    judged += _judge_pairs(beside, frames, poses @ sequence.vehicle_from_sonar, tracked)
    supported = _find_supported(judged, window)
    poses, loops = _close([check.matches for _, check in supported], frames, solution, tracked)
    report.counts = {
        "pairs looked at": len(chosen) + len(beside),
        "loops": len(loops),
        "matches": sum(len(match) for match in loops),
        **_count_reasons(judged, supported, len(supported) - len(loops)),
    }
    return Closure(poses, [replace(match, cost=match.cost + LOOP_COST_OFFSET) for match in loops])


def _judge_pairs(
    pairs: Iterable[LoopPair], frames: _LoopFrames, world_from_sonar: FloatArray, tracked: KeypointTracks
) -> list[Judged]:
    """Match and verify pairs whose descriptors are alike."""
    judged = []
    for pair in pairs:
        if place_similarity(frames.load(pair.frame_a), frames.load(pair.frame_b)) >= frames.config.loops.min_similarity:
            judged.append((pair, _judge_pair(pair, frames, world_from_sonar, tracked)))
    return judged


def _judge_pair(
    pair: LoopPair, frames: _LoopFrames, world_from_sonar: FloatArray, tracked: KeypointTracks
) -> LoopCheck:
    sonar, config = frames.sequence.sonar, frames.config
    root = float(np.sqrt(pair.frame_b - pair.frame_a))
    predicted = PosePrediction(world_from_sonar, pair.bearing_sigma_rad / root, pair.range_sigma_m / root)
    matches = match_pairs([(pair.frame_a, pair.frame_b)], frames.keypoints, config, sonar, predicted)
    (aligned,) = align_matches(matches, frames.keypoints, sonar, config)
    return verify_loop(aligned, frames.keypoints, sonar, predicted, tracked, config)


def _list_neighbours(search: LoopSearch, judged: list[Judged], window: int) -> list[LoopPair]:
    """List the pairs beside the sure ones that nothing supports yet."""
    supported, known = {pair for pair, _ in _find_supported(judged, window)}, {pair for pair, _ in judged}
    lonely = [pair for pair, check in judged if check.sure and pair not in supported]
    found = [other for pair in lonely for other in find_neighbours(search, pair)]
    return [pair for pair in dict.fromkeys(found) if pair not in known]


def _find_supported(judged: list[Judged], window: int) -> list[Judged]:
    """Give the accepted pairs that another one, close in both frames, agrees with; one of the two is sure."""
    accepted = [(pair, check) for pair, check in judged if check.accepted]
    return [one for one in accepted if any(are_mutually_consistent(one[1], other[1], 2 * window) for other in accepted)]


def _close(
    loops: list[Matches], frames: _LoopFrames, solution: Solution, tracked: KeypointTracks
) -> tuple[FloatArray, list[Matches]]:
    """Close the loops, leave out those that the closed trajectory contradicts, and close the others again.

    Where many contradict each other there is no telling which are right, and all are left out. Where the poses of
    before agree with all of them there is nothing to close: their matches join the tracks, and the poses stay.
    """
    poses, sequence, config = solution.bundle.world_from_vehicle, frames.sequence, frames.config
    correlation = config.backend.track_correlation
    sigma = feature_sigma(sequence.sonar, config.noise)
    while loops:
        observations = loop_observations(loops, tracked)
        closed = close_loops(solution.bundle, observations, sigma, sequence.vehicle_from_sonar, correlation)
        stands = _find_consistent(loops, closed, frames)
        if all(stands):
            return poses if all(_find_consistent(loops, poses, frames)) else closed, loops
        if sum(stands) < MIN_CONSISTENT_SHARE * len(stands):
            return poses, []
        loops = [match for match, fine in zip(loops, stands, strict=True) if fine]
    return poses, loops


def _find_consistent(loops: list[Matches], world_from_vehicle: FloatArray, frames: _LoopFrames) -> list[bool]:
    """Tell which loops the poses agree with."""
    sonar, config = frames.sequence.sonar, frames.config
    world_from_sonar = world_from_vehicle @ frames.sequence.vehicle_from_sonar
    sigma, gate = difference_sigma(sonar, config.noise), config.matching.arc_gate
    return [
        arc_inlier_ratio(match, frames.keypoints, sonar, world_from_sonar, sigma, gate) >= MIN_INLIER_RATIO
        for match in loops
    ]


def loop_observations(loops: list[Matches], tracked: KeypointTracks) -> Tracks:
    """Turn matches into observations of each side's landmark by the other side's frame, each only once."""
    rows = []
    for match in loops:
        for frame, other, (own, theirs) in (
            (match.frame_a, match.frame_b, match.index.T),
            (match.frame_b, match.frame_a, match.index.T[::-1]),
        ):
            track, seen = tracked.find(other, theirs), tracked.keypoints[frame]
            same = track == tracked.find(frame, own)
            places = np.stack([track, np.full(len(own), frame), seen.range_m[own], seen.bearing_rad[own]], axis=1)
            rows.append(places[(track >= 0) & ~same])
    table = np.unique(np.concatenate(rows), axis=0)
    return Tracks(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2], table[:, 3])


def _count_reasons(judged: list[Judged], supported: list[Judged], contradicted: int) -> dict[str, float]:
    reasons = [check.reason for _, check in judged if not check.accepted]
    alone = len(judged) - len(reasons) - len(supported)
    reasons += ["standing alone"] * alone + ["contradiction"] * contradicted
    return {f"rejected for {name}": reasons.count(name) for name in dict.fromkeys(reasons)}
