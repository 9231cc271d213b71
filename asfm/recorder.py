"""Recorder interface: observes the stages of the pipeline, for example to visualize them."""

from typing import Protocol

from asfm.sequence import Sequence
from asfm.types import BoolArray, Frame, Keypoints, Matches, Reconstruction


class Recorder(Protocol):
    """Observer of a run; the pipeline calls every method, whether or not anything is recorded."""

    def record_frame(self, frame: Frame, mask: BoolArray, keypoints: Keypoints) -> None:
        """Record the mask and keypoints of a frame; called once per frame, in order; again for turned images."""

    def record_matches(self, frame_a: Keypoints, frame_b: Keypoints, matches: Matches) -> None:
        """Record the matches of a frame (b) with the previous one (a); called for every frame but the first."""

    def record_reconstruction(self, sequence: Sequence, reconstruction: Reconstruction) -> None:
        """Record the result; called once, at the end."""

    def close(self) -> None:
        """Finish the recording; no other method may be called afterwards."""


class NullRecorder:
    """Recorder that discards everything."""

    def _ignore(self, *args: object, **kwargs: object) -> None:
        """Do nothing."""

    record_frame = record_matches = record_reconstruction = close = _ignore
