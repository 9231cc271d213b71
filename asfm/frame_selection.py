"""Selection of frames: a part of a recording, from a first frame to a last one, or every n-th."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from asfm.config import FramesConfig
from asfm.errors import AsfmError
from asfm.sequence import Sequence
from asfm.types import ExternalMatches, Frame, FrameTruth, IntArray


def choose_frames(sequence: Sequence, config: FramesConfig) -> IntArray:
    """Return the numbers (M,) of the chosen frames in the recording, rising.

    Args:
        sequence: the whole recording.
        config: first, last and step.

    Raises:
        AsfmError: the recording has no such frame, or none lies between the first and the last one.
    """
    end = len(sequence) - 1
    for name, value in (("first", config.first), ("last", config.last)):
        if value is not None and value > end:
            raise AsfmError(f"frames.{name}: expected a frame of {sequence.name}, which has 0 to {end}, found {value}")
    last = end if config.last is None else config.last
    if last < config.first:
        raise AsfmError(f"frames.last: expected frames.first ({config.first}) or a later frame, found {last}")
    return np.arange(config.first, last + 1, config.every)


def take_frames(sequence: Sequence, chosen: IntArray) -> Sequence:
    """Return a sequence of the (M,) chosen frames, numbered from 0.

    Readings of other sensors keep their own stamps, and what the reader found is said of the whole recording.
    """
    if len(chosen) == len(sequence):
        return sequence

    def read_frame(index: int) -> Frame:
        return replace(sequence.read_frame(int(chosen[index])), index=index)

    found = tuple(
        replace(item, message=f"in the whole recording: {item.message}", frames=()) for item in sequence.diagnostics
    )
    return replace(sequence, timestamps_s=sequence.timestamps_s[chosen], read_frame=read_frame, diagnostics=found)


def take_truth(read_truth: Callable[[int], FrameTruth], chosen: IntArray) -> Callable[[int], FrameTruth]:
    """Return the reader of the true elevations of the (M,) chosen frames."""
    return lambda index: read_truth(int(chosen[index]))


def take_matches(external: ExternalMatches, chosen: IntArray) -> ExternalMatches:
    """Return the keypoints of the (M,) chosen frames and the matches between them, with their numbers."""
    number = {frame: index for index, frame in enumerate(chosen.tolist())}
    matches = (
        replace(match, frame_a=number[match.frame_a], frame_b=number[match.frame_b])
        for match in external.matches
        if match.frame_a in number and match.frame_b in number
    )
    return ExternalMatches(tuple(external.keypoints[frame] for frame in chosen.tolist()), tuple(matches))
