"""``asfm denoise``: how close several ways of denoising come to the image without noise."""

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

FRAMES_OF_SEQUENCE, FRAMES_OF_SIMULATION = 10, 1
"""By default, of each sequence, and of each scene and sonar."""


@dataclass(frozen=True)
class Source:
    """Frames with their truth."""

    scene: str
    """Name of the scene, or of the sequence."""
    sonar: str
    read: Callable[[int], tuple[Frame, FrameTruth]]
    indices: tuple[int, ...]
    """Of the frames; where they are simulated, their seeds."""
    simulated: bool


def denoise_sources(
    sequences: Names[Path] = (),
    scenes: Names[str] = (),
    sonars: Names[str] = (),
    frames: int | None = None,
    seed: int = 0,
    config: Config | None = None,
    output: Path | None = None,
    overwrite: bool = False,
    progress: Progress = no_progress,
) -> "DenoisingTable":
    """Compare the ways of denoising over sequences with truth, or over simulated scenes and sonars.

    Args:
        sequences: native folders with truth; none means to simulate.
        scenes: names of scenes to simulate; all where none is given.
        sonars: names of sonars to simulate; all where none is given.
        frames: of each sequence, spread evenly, 10 by default; or of each scene and sonar, every one of another seed,
            1 by default.
        seed: of the first simulated frame.
        config: settings of the mask.
        output: folder for the table as CSV and JSON and for a picture.
        overwrite: replace such a folder.
        progress: told how many frames are compared.

    Raises:
        AsfmError: a sequence without truth, an unknown scene or sonar, images too small for SSIM, sequences together
            with scenes or sonars, fewer than one frame, or the folder cannot be written.
    """
    if frames is not None and frames < 1:
        raise AsfmError(f"expected at least one frame to denoise, found {frames}")
    if sequences and (scenes or sonars):
        raise AsfmError("expected sequences, or scenes and sonars to simulate, found both")
    if sequences:
        sources = [_open_source(path, frames or FRAMES_OF_SEQUENCE) for path in sequences]
    else:
        sources = _plan(scenes, sonars, frames or FRAMES_OF_SIMULATION, seed)
    if output is None:
        return _compare(sources, config or Config(), progress)[0]
    with atomic_folder(output, DENOISING, overwrite) as partial:
        table, examples = _compare(sources, config or Config(), progress)
        write_denoising(partial, table, examples)
    return table


def _open_source(path: Path, frames: int) -> Source:
    from asfm.datasets import open_sequence, open_truth

    sequence, truth = open_sequence(path), open_truth(path)
    if truth is None:
        raise AsfmError(f"{path}: expected a sequence with truth, found no truth folder: asfm simulate makes one")
    read_truth, count = truth, min(frames, len(sequence))
    indices = [(2 * number + 1) * len(sequence) // (2 * count) for number in range(count)]

    def read(index: int) -> tuple[Frame, FrameTruth]:
        return sequence.read_frame(index), read_truth(index)

    return Source(str(path), sequence.sonar.name, read, tuple(indices), simulated=False)


def _plan(scenes: Names[str], sonars: Names[str], frames: int, seed: int) -> list[Source]:
    """List what is to be simulated, all names checked before the first is."""
    from asfm.simulation.scenes.catalogue import SCENES, find_scene
    from asfm.simulation.simulate import find_sonar
    from asfm.simulation.sonars.presets import PRESETS

    scenes, sonars = tuple(dict.fromkeys(scenes)) or tuple(SCENES), tuple(dict.fromkeys(sonars)) or tuple(PRESETS)
    for scene in scenes:
        find_scene(scene)
    for sonar in sonars:
        find_sonar(sonar)
    if seed < 0:
        raise AsfmError(f"expected a seed of zero or more, found {seed}")
    indices = tuple(range(seed, seed + frames))
    return [Source(scene, sonar, _simulate_frames(scene, sonar), indices, True) for scene in scenes for sonar in sonars]


def _simulate_frames(scene: str, sonar: str) -> Callable[[int], tuple[Frame, FrameTruth]]:
    def read(seed: int) -> tuple[Frame, FrameTruth]:
        from asfm.simulation.simulate import simulate

        simulated = simulate(scene, sonar, 1, seed)
        return replace(simulated.sequence.read_frame(0), index=seed), simulated.read_truth(0)

    return read


def _compare(
    sources: list[Source], config: Config, progress: Progress
) -> "tuple[DenoisingTable, dict[str, tuple[FrameTruth, Comparison]]]":
    """Compare on all frames; give the table, and the first frame of each scene as an example.

    A seed that puts the sonar into an object costs its frame only.
    """
    from asfm.evaluation.denoising.table import DenoisedFrame, DenoisingTable, compare_denoisers

    rows: list[DenoisedFrame] = []
    notes: list[str] = []
    examples: dict[str, tuple[FrameTruth, Comparison]] = {}
    total = sum(len(source.indices) for source in sources)
    for done, (source, index) in enumerate(_walk(sources)):
        progress("denoise", done, total)
        try:
            frame, truth = source.read(index)
        except AsfmError as error:
            if not source.simulated:
                raise
            notes.append(f"without {source.scene} before {source.sonar} of seed {index}: {error}")
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


def _walk(sources: list[Source]) -> Iterator[tuple[Source, int]]:
    return ((source, index) for source in sources for index in source.indices)
