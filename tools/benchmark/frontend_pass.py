"""One passage of a sequence through the front-end: its time beside A-KAZE's, and its matches beside the truth."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from asfm.config import Config
from asfm.evaluation.arc_consistency import fits_arc
from asfm.evaluation.matching import find_true_positions, judge_matches
from asfm.frontend.features.detectors import DETECTORS, Picture
from asfm.frontend.features.keypoints import warp_image
from asfm.frontend.matching.nearest import match_keypoints
from asfm.geometry.poses import interpolate, invert
from asfm.pipeline.reconstruction import extract_matches
from asfm.recorder import NullRecorder
from asfm.sequence import Sequence
from asfm.stages import StageClock
from asfm.types import BoolArray, FloatArray, Frame, FrameTruth, Keypoints, Matches


@dataclass(frozen=True)
class FrontendPass:
    """What the front-end made of a sequence, and what a frame took."""

    keypoints: list[Keypoints]
    candidates: list[Matches]
    frame_s: float
    """Of everything that ``extract_matches`` does once frames are read, over their number."""
    akaze_s: float
    """Median of A-KAZE alone on the same pictures, without a mask."""

    def pairs(self, gap: int) -> list[Matches]:
        """Give the candidates of frames so far apart."""
        return [matches for matches in self.candidates if matches.frame_b - matches.frame_a == gap]


@dataclass(frozen=True)
class Judged:
    """What truth says of the matches over one gap."""

    matches: int
    right: int
    ratio_test_matches: int
    ratio_test_right: int
    error: FloatArray
    """(right, 2) seen minus true place, in range bins and beams."""

    @property
    def precision(self) -> float | None:
        """Right ones of those that every filter let pass."""
        return self.right / self.matches if self.matches else None

    @property
    def ratio_test_precision(self) -> float | None:
        """Right ones of those that the ratio test and mutuality let pass."""
        return self.ratio_test_right / self.ratio_test_matches if self.ratio_test_matches else None

    @property
    def kept(self) -> float | None:
        """Right ones after all filters over those after the ratio test."""
        return self.right / self.ratio_test_right if self.ratio_test_right else None

    def spread(self, axis: int) -> tuple[float | None, float | None]:
        """Give standard deviation and absolute mean of the error along one axis."""
        if not len(self.error):
            return None, None
        return float(self.error[:, axis].std()), float(abs(self.error[:, axis].mean()))


def run_frontend(sequence: Sequence, config: Config, clock: Callable[[], float]) -> FrontendPass:
    """Time A-KAZE alone on every frame, then let the pipeline extract keypoints and matches from all of them.

    The frames lie in memory. What a frame takes is the time from the first frame that has ``max_gap`` frames before it
    (unless none has) to the end, over their number: a run works on two frames at once, so no frame has a time of its
    own. What is left to do of the two frames before counts too.
    """
    frames = list(sequence)
    detect_alone = (
        DETECTORS["akaze"]
        .make(config.keypoints.threshold or DETECTORS["akaze"].threshold, config.keypoints)
        .detectAndCompute
    )
    first = config.matching.max_gap if len(frames) > config.matching.max_gap + 1 else 0
    alone_s = [_time(clock, detect_alone, warp_image(frame, sequence.sonar, config)) for frame in frames[first:]]
    asked_s = np.zeros(len(frames))

    def read(index: int) -> Frame:
        asked_s[index] = clock()
        return frames[index]

    keypoints, candidates = extract_matches(replace(sequence, read_frame=read), config, NullRecorder(), StageClock())
    frame_s = (clock() - float(asked_s[first])) / (len(frames) - first)
    return FrontendPass(keypoints, candidates, frame_s, float(np.median(alone_s)))


def _time(clock: Callable[[], float], detect: Callable[[Picture, None], object], picture: Picture) -> float:
    begin_s = clock()
    detect(picture, None)
    return clock() - begin_s


def judge_by_truth(
    passage: FrontendPass, sequence: Sequence, read_truth: Callable[[int], FrameTruth], gap: int, config: Config
) -> Judged:
    """Compare the matches over one gap with where a simulation's points truly are."""
    world_from_sonar = _true_poses(sequence)
    unit = np.array([sequence.sonar.range_step_m, sequence.sonar.bearing_step_rad])
    counts, errors = np.zeros(4, dtype=int), [np.zeros((0, 2))]
    for matches in passage.pairs(gap):
        a, b = passage.keypoints[matches.frame_a], passage.keypoints[matches.frame_b]
        b_from_a = invert(world_from_sonar[matches.frame_b]) @ world_from_sonar[matches.frame_a]
        truth = find_true_positions(a, read_truth(matches.frame_a).elevation_rad, b_from_a)
        proposed = _after_ratio_test(matches, passage, config)
        right, right_proposed = (judge_matches(truth, b, each) for each in (matches, proposed))
        counts += (len(matches), right.sum(), len(proposed), right_proposed.sum())
        true_place = np.stack([truth.range_m, truth.bearing_rad], axis=1)[matches.index[:, 0]]
        errors.append((seen_places(b, matches) - true_place)[right] / unit)
    count, right_count, proposed_count, right_proposed_count = counts.tolist()
    return Judged(count, right_count, proposed_count, right_proposed_count, np.concatenate(errors))


def judge_by_arcs(
    passage: FrontendPass, sequence: Sequence, gap: int, config: Config
) -> tuple[float | None, float | None]:
    """Give the share of matches on their elevation arc under the true poses: after all filters, and the ratio test."""
    world_from_sonar = _true_poses(sequence)
    fits: tuple[list[BoolArray], list[BoolArray]] = [], []
    for matches in passage.pairs(gap):
        a, b = passage.keypoints[matches.frame_a], passage.keypoints[matches.frame_b]
        b_from_a = invert(world_from_sonar[matches.frame_b]) @ world_from_sonar[matches.frame_a]
        for found, each in zip(fits, (matches, _after_ratio_test(matches, passage, config)), strict=True):
            of_a, (range_m, bearing_rad) = each.index[:, 0], seen_places(b, each).T
            found.append(fits_arc(a.range_m[of_a], a.bearing_rad[of_a], range_m, bearing_rad, b_from_a, sequence.sonar))
    share, of_ratio_test = (float(np.concatenate(each).mean()) if sum(map(len, each)) else None for each in fits)
    return share, of_ratio_test


def seen_places(keypoints_b: Keypoints, matches: Matches) -> FloatArray:
    """Give the (M, 2) range_m and bearing_rad at which frame b shows the keypoints of frame a."""
    if matches.aligned is not None:
        return matches.aligned
    of_b = matches.index[:, 1]
    return np.stack([keypoints_b.range_m[of_b], keypoints_b.bearing_rad[of_b]], axis=1)


def _after_ratio_test(matches: Matches, passage: FrontendPass, config: Config) -> Matches:
    """Match the same two frames by descriptors alone."""
    a, b = passage.keypoints[matches.frame_a], passage.keypoints[matches.frame_b]
    return Matches(matches.frame_a, matches.frame_b, *match_keypoints(a, b, config.matching))


def _true_poses(sequence: Sequence) -> FloatArray:
    """Give the true (N, 4, 4) world_from_sonar.

    Raises:
        ValueError: the sequence has no ground truth.
    """
    truth = sequence.groundtruth
    if truth is None:
        raise ValueError(f"{sequence.name}: expected ground truth, found none")
    poses = interpolate(truth.timestamps_s, truth.world_from_vehicle, sequence.timestamps_s)
    return np.asarray(poses @ sequence.vehicle_from_sonar)
