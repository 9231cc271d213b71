"""Acoustic structure from motion from end to end, as the paper's block diagram."""

from dataclasses import dataclass

from asfm.config import Config
from asfm.recorder import NullRecorder, Recorder
from asfm.sequence import Sequence
from asfm.stages import Progress, StageReport, no_progress
from asfm.types import Reconstruction


@dataclass(frozen=True)
class Run:
    """A reconstruction and what it took."""

    reconstruction: Reconstruction
    stages: tuple[StageReport, ...]


def reconstruct(
    sequence: Sequence,
    config: Config,
    recorder: Recorder | None = None,
    progress: Progress = no_progress,
) -> Run:
    """Reconstruct trajectory and landmarks of a sequence."""
    raise NotImplementedError
