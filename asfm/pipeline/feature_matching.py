"""Feature matching of a whole sequence: images to keypoints, frame pairs to filtered candidate matches."""

from collections.abc import Callable

from asfm.config import Config
from asfm.frontend.denoising.echo_mask import detect_echo_mask
from asfm.frontend.features.keypoints import cut_keypoint_patches, detect_keypoints
from asfm.frontend.matching.external_matches import filter_external_matches
from asfm.frontend.matching.pair_matching import match_with_previous
from asfm.frontend.matching.patch_alignment import align_matches
from asfm.navigation.pose_prediction import PosePrediction
from asfm.prefetch import prefetch_map
from asfm.recorder import Recorder
from asfm.sequence import Sequence
from asfm.stages import StageClock
from asfm.types import BoolArray, ExternalMatches, Frame, Keypoints, Matches

ExtractMatches = Callable[
    [Sequence, Config, Recorder, StageClock, PosePrediction | None, ExternalMatches | None],
    tuple[list[Keypoints], list[Matches]],
]
"""Signature of :func:`extract_matches`."""


def extract_matches(
    sequence: Sequence,
    config: Config,
    recorder: Recorder,
    clock: StageClock,
    prediction: PosePrediction | None = None,
    external: ExternalMatches | None = None,
) -> tuple[list[Keypoints], list[Matches]]:
    """Detect the keypoints of every frame and match each frame with those before it.

    At most two images are in memory at a time; the features of the next frame are computed while one is matched.

    Args:
        sequence: frames and sonar.
        config: sections of the front-end.
        recorder: observer of frames and matches.
        clock: times the stage.
        prediction: poses before the images are read, for the arc filter; None without odometry.
        external: keypoints and matches computed elsewhere in place of asfm's own.

    Returns:
        The keypoints of every frame, and the filtered matches of every pair of frames.

    Raises:
        AsfmError: a frame cannot be read.
    """

    def detect(frame: Frame) -> tuple[Frame, BoolArray, Keypoints]:
        mask = detect_echo_mask(frame, config)
        if external is None:
            return frame, mask, detect_keypoints(frame, mask, sequence.sonar, config)
        return frame, mask, cut_keypoint_patches(frame, external.keypoints[frame.index], sequence.sonar, config)

    keypoints: list[Keypoints] = []
    candidates: list[Matches] = []
    longest_gap = config.matching.max_gap if external is None else external.longest_gap
    with clock.stage("front-end") as report:
        for frame, mask, found in prefetch_map(detect, sequence):
            keypoints.append(found)
            if external is None:
                matches = match_with_previous(frame.index, keypoints, config, sequence.sonar, prediction)
            else:
                matches = filter_external_matches(external, frame.index, keypoints, config, sequence.sonar, prediction)
            matches = align_matches(matches, keypoints, sequence.sonar, config)
            candidates += matches
            recorder.record_frame(frame, mask, keypoints[-1])
            if matches:
                recorder.record_matches(keypoints[matches[0].frame_a], keypoints[-1], matches[0])
            _drop_patches(keypoints, frame.index - longest_gap)
            clock.progress("front-end", frame.index + 1, len(sequence))
        report.counts = {
            "frames": len(sequence),
            "keypoints": sum(len(frame) for frame in keypoints),
            "matches": sum(len(match) for match in candidates),
            **_count_rejected(candidates),
        }
    return keypoints, candidates


def _count_rejected(candidates: list[Matches]) -> dict[str, int]:
    """Count the matches that each filter rejected, over all pairs of frames."""
    counts: dict[str, int] = {}
    for matches in candidates:
        for name, count in matches.count_rejected().items():
            counts[f"rejected by {name}"] = counts.get(f"rejected by {name}", 0) + count
    return counts


def _drop_patches(keypoints: list[Keypoints], index: int) -> None:
    """Free the patches of a frame that no later frame is matched with."""
    if index >= 0:
        keypoints[index] = keypoints[index].without_patches()
