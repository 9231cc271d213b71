"""Command ``asfm denoise``: compare denoising methods against noise-free images."""

from collections.abc import Callable, Iterator
from collections.abc import Sequence as Names
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from asfm.atomic_folder import atomic_folder
from asfm.commands.denoise_files import DENOISING, write_denoising
from asfm.config import Config
from asfm.errors import AsfmError
from asfm.stages import Progress, no_progress
from asfm.types import Frame, FrameTruth

if TYPE_CHECKING:
    from asfm.evaluation.denoising.table import Comparison, DenoisingTable

FRAMES_PER_SEQUENCE, FRAMES_PER_SIMULATION = 10, 1
"""Default number of frames of each sequence, and of each simulated pair of scene and sonar."""


@dataclass(frozen=True)
class DenoiseSources:
    """The frames to compare on: from sequences with truth, or simulated from scenes and sonars."""

    sequences: Names[Path] = ()
    """Native folders with truth; frames are simulated where it is empty."""
    scenes: Names[str] = ()
    """Names of scenes to simulate, or mesh files; all scenes where it is empty."""
    sonars: Names[str] = ()
    """Names of sonars to simulate, or HoloOcean scenarios; all presets where it is empty."""
    frames: int | None = None
    """Frames of each sequence, spread evenly (10 by default), or of each scene and sonar (1 by default)."""
    seed: int = 0
    """Seed of the first simulated frame; each further frame has the next seed."""


@dataclass(frozen=True)
class _Source:
    """Frames with their truth, from one sequence or one pair of scene and sonar."""

    scene: str
    """Name of the scene, or of the sequence."""
    sonar: str
    read: Callable[[int], tuple[Frame, FrameTruth]]
    indices: tuple[int, ...]
    """Frame indices; seeds where the frames are simulated."""
    simulated: bool


def denoise_sources(
    sources: DenoiseSources | None = None,
    config: Config | None = None,
    output: Path | None = None,
    overwrite: bool = False,
    progress: Progress = no_progress,
) -> "DenoisingTable":
    """Compare the denoising methods on sequences with truth, or on simulated frames.

    Args:
        sources: the frames; one simulated frame of every scene and sonar where it is None.
        config: settings of the echo mask and of the denoiser; the defaults where it is None.
        output: folder for the table as CSV and JSON and for a picture; nothing is written where it is None.
        overwrite: replace an existing table.
        progress: receives the number of frames compared.

    Raises:
        AsfmError: a sequence has no truth, a scene or sonar is unknown, images are too small for SSIM, sequences are
            given together with scenes or sonars, fewer than one frame, or the folder cannot be written.
    """
    opened = _open_sources(sources or DenoiseSources())
    if output is None:
        return _compare(opened, config or Config(), progress)[0]
    with atomic_folder(output, DENOISING, overwrite) as partial:
        table, examples = _compare(opened, config or Config(), progress)
        write_denoising(partial, table, examples)
    return table


def _open_sources(sources: DenoiseSources) -> list[_Source]:
    if sources.frames is not None and sources.frames < 1:
        raise AsfmError(f"expected at least one frame to denoise, found {sources.frames}")
    if sources.sequences and (sources.scenes or sources.sonars):
        raise AsfmError("expected sequences, or scenes and sonars to simulate, found both")
    if sources.sequences:
        return [_open_sequence(path, sources.frames or FRAMES_PER_SEQUENCE) for path in sources.sequences]
    return _plan_simulation(sources)


def _open_sequence(path: Path, frames: int) -> _Source:
    from asfm.datasets import open_sequence, open_truth

    sequence, truth = open_sequence(path), open_truth(path)
    if truth is None:
        raise AsfmError(f"{path}: expected a sequence with truth, found no truth folder: asfm simulate writes one")
    read_truth, count = truth, min(frames, len(sequence))
    indices = [(2 * number + 1) * len(sequence) // (2 * count) for number in range(count)]

    def read(index: int) -> tuple[Frame, FrameTruth]:
        return sequence.read_frame(index), read_truth(index)

    return _Source(str(path), sequence.sonar.name, read, tuple(indices), simulated=False)


def _plan_simulation(sources: DenoiseSources) -> list[_Source]:
    """List the pairs of scene and sonar; all names are checked before the first frame is simulated."""
    from asfm.simulation.scenes.catalogue import SCENES, find_scene
    from asfm.simulation.simulate import find_sonar
    from asfm.simulation.sonars.presets import PRESETS

    scenes = tuple(dict.fromkeys(sources.scenes)) or tuple(SCENES)
    sonars = tuple(dict.fromkeys(sources.sonars)) or tuple(PRESETS)
    for scene in scenes:
        find_scene(scene)
    for sonar in sonars:
        find_sonar(sonar)
    if sources.seed < 0:
        raise AsfmError(f"expected a seed of zero or more, found {sources.seed}")
    seeds = tuple(range(sources.seed, sources.seed + (sources.frames or FRAMES_PER_SIMULATION)))
    return [_Source(scene, sonar, _simulate_frames(scene, sonar), seeds, True) for scene in scenes for sonar in sonars]


def _simulate_frames(scene: str, sonar: str) -> Callable[[int], tuple[Frame, FrameTruth]]:
    """Return a function that simulates one frame with its truth from a seed."""

    def read(seed: int) -> tuple[Frame, FrameTruth]:
        from asfm.simulation.simulate import simulate

        simulated = simulate(scene, sonar, 1, seed)
        return replace(simulated.sequence.read_frame(0), index=seed), simulated.read_truth(0)

    return read


def _compare(
    sources: list[_Source], config: Config, progress: Progress
) -> "tuple[DenoisingTable, dict[str, tuple[FrameTruth, Comparison]]]":
    """Compare on all frames; returns the table, and the first frame of each scene as an example.

    A seed that places the sonar inside an object is skipped with a note.
    """
    from asfm.evaluation.denoising.table import DenoisedFrame, DenoisingTable, compare_denoisers

    rows: list[DenoisedFrame] = []
    notes: list[str] = []
    examples: dict[str, tuple[FrameTruth, Comparison]] = {}
    total = sum(len(source.indices) for source in sources)
    for done, (source, index) in enumerate(_iterate(sources)):
        progress("denoise", done, total)
        try:
            frame, truth = source.read(index)
        except AsfmError as error:
            if not source.simulated:
                raise
            notes.append(f"without {source.scene}, {source.sonar}, of seed {index}: {error}")
            continue
        try:
            comparison = compare_denoisers(frame, truth, config)
        except AsfmError as error:
            raise AsfmError(f"{source.scene}, {source.sonar}, frame {index}: {error}") from None
        rows += comparison.rows(source.scene, source.sonar, index)
        examples.setdefault(source.scene, (truth, comparison))
    progress("denoise", total, total)
    if not rows:
        raise AsfmError(notes[0])
    return DenoisingTable(tuple(rows), tuple(notes)), examples


def _iterate(sources: list[_Source]) -> Iterator[tuple[_Source, int]]:
    return ((source, index) for source in sources for index in source.indices)
