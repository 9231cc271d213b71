"""Whoever watches a run: the pipeline talks to a recorder and never asks whether anybody looks."""

from typing import Protocol

from asfm.sequence import Sequence
from asfm.types import BoolArray, Frame, Keypoints, Matches, Reconstruction


class Recorder(Protocol):
    """Whoever watches a run."""

    def record_frame(self, frame: Frame, mask: BoolArray, keypoints: Keypoints) -> None:
        """Take what the front-end found in a frame; once a frame, in order."""

    def record_matches(self, frame_a: Keypoints, frame_b: Keypoints, matches: Matches) -> None:
        """Take the surviving matches of a frame (b) with the one before it (a); for all but the first, even if none."""

    def record_reconstruction(self, sequence: Sequence, reconstruction: Reconstruction) -> None:
        """Take the result, once, in the end."""

    def close(self) -> None:
        """Finish; nothing may be recorded afterwards."""


class NullRecorder:
    """Watch nothing."""

    def _ignore(self, *args: object, **kwargs: object) -> None:
        """Do nothing."""

    record_frame = record_matches = record_reconstruction = close = _ignore
