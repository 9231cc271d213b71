"""Sequences of a study: recordings opened where they are, simulated ones written once to the study's cache."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from asfm.datasets import open_sequence, open_truth
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError
from asfm.frame_selection import choose_frames, take_frames, take_truth
from asfm.sequence import Sequence
from asfm.study.cell import Cell, Simulation
from asfm.study.feature_cache import StudyCache
from asfm.study.study_definition import Mode
from asfm.types import FrameTruth, IntArray


@dataclass(frozen=True)
class StudySequence:
    """A sequence of a study, with what is known about it."""

    path: Path
    whole: Sequence
    """All frames of the recording."""
    chosen: IntArray
    """(N,) indices of the frames that are used."""
    sequence: Sequence
    """The frames that are used."""
    read_truth: Callable[[int], FrameTruth] | None
    """Reads the true elevations of a used frame; None for a recording."""


def provide_sequence(cell: Cell, cache: StudyCache) -> StudySequence:
    """Open the sequence of a cell, simulated first where that has not been done.

    Raises:
        AsfmError: the sequence cannot be read or simulated.
    """
    path = _simulate(cell, cache) if isinstance(cell.sequence, Simulation) else cell.sequence.path
    whole, truth = open_sequence(path), open_truth(path)
    chosen = choose_frames(whole, cell.config.frames)
    sequence = replace(take_frames(whole, chosen), name=cell.sequence.name)
    return StudySequence(path, whole, chosen, sequence, truth and take_truth(truth, chosen))


def check_sensors(sequence: Sequence, mode: Mode) -> None:
    """Check that a sequence has the sensors of a mode.

    Raises:
        AsfmError: it has no odometry, or neither odometry nor depth and attitude.
    """
    if mode == "odometry" and sequence.odometry is None:
        raise AsfmError(f"{sequence.name}: mode odometry needs odometry, found none")
    if mode == "all" and sequence.odometry is None and sequence.navigation is None:
        raise AsfmError(f"{sequence.name}: mode all needs odometry, or depth and attitude, found none")


def _simulate(cell: Cell, cache: StudyCache) -> Path:
    source = cell.sequence
    assert isinstance(source, Simulation)

    def write(folder: Path) -> None:
        from asfm.simulation.simulate import simulate  # loads the ray caster

        made = simulate(
            source.scene, source.sonar, source.frames, cell.seed, source.motion, scene_seed=source.scene_seed
        )
        write_native(folder / "sequence", made.sequence, truth=made.read_truth)

    return cache.provide("sequences", cell.sequence_key, write) / "sequence"
