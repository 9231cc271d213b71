"""Front-end pass over a sequence: its keypoints and matches, and its time beside that of A-KAZE alone."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from asfm.config import Config, MatchingConfig
from asfm.frontend.features.detectors import DETECTORS, Picture
from asfm.frontend.features.keypoints import warp_image
from asfm.frontend.matching.nearest import match_keypoints
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.pose_prediction import predict_poses
from asfm.pipeline.feature_matching import extract_matches
from asfm.pipeline.noise_estimation import estimate_noise
from asfm.recorder import NullRecorder
from asfm.sequence import Sequence
from asfm.stages import StageClock
from asfm.types import Frame, Keypoints, Matches


@dataclass(frozen=True)
class FrontendPass:
    """Keypoints and matches of a sequence, and the time of a frame."""

    keypoints: list[Keypoints]
    candidates: list[Matches]
    frame_s: float
    """Wall time of ``extract_matches`` without reading frames, over the number of frames."""
    akaze_s: float
    """Median over frames of A-KAZE alone on the same images, without a mask."""

    def pairs(self, gap: int) -> list[Matches]:
        """Return the candidates of one frame gap."""
        return [matches for matches in self.candidates if matches.frame_b - matches.frame_a == gap]


def run_frontend(sequence: Sequence, config: Config, clock: Callable[[], float]) -> FrontendPass:
    """Time A-KAZE alone on every frame, then let the pipeline extract keypoints and matches of all frames.

    The frames are held in memory. The time of a frame is that from the first frame with ``max_gap`` frames before it
    (from the very first where none has) to the end, over their number: the pipeline works on two frames at once, so
    that no frame has a time of its own. The work left over from the two frames before is included.
    """
    frames = list(sequence)
    akaze = (
        DETECTORS["akaze"]
        .make(config.keypoints.threshold or DETECTORS["akaze"].threshold, config.keypoints)
        .detectAndCompute
    )
    first = config.matching.max_gap if len(frames) > config.matching.max_gap + 1 else 0
    akaze_s = [_time(clock, akaze, warp_image(frame, sequence.sonar, config)) for frame in frames[first:]]
    read_s = np.zeros(len(frames))

    def read(index: int) -> Frame:
        read_s[index] = clock()
        return frames[index]

    config = estimate_noise(sequence, config, StageClock())
    prediction = predict_poses(read_navigation(sequence, config.backend), sequence)
    in_memory = replace(sequence, read_frame=read)
    keypoints, candidates = extract_matches(in_memory, config, NullRecorder(), StageClock(), prediction)
    frame_s = (clock() - float(read_s[first])) / (len(frames) - first)
    return FrontendPass(keypoints, candidates, frame_s, float(np.median(akaze_s)))


def _time(clock: Callable[[], float], detect: Callable[[Picture, None], object], picture: Picture) -> float:
    begin_s = clock()
    detect(picture, None)
    return clock() - begin_s


def match_by_descriptors(keypoints: list[Keypoints], pairs: Iterable[Matches], config: MatchingConfig) -> list[Matches]:
    """Match the same frame pairs by mutual nearest descriptors and the ratio test alone."""
    return [
        Matches(a, b, *match_keypoints(keypoints[a], keypoints[b], config))
        for a, b in ((pair.frame_a, pair.frame_b) for pair in pairs)
    ]
