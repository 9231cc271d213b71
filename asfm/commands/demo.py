"""``asfm demo``: simulate, reconstruct and evaluate, without any data of one's own."""

from pathlib import Path

from asfm.commands.run import run_sequence
from asfm.commands.simulate import DEFAULT_FRAMES, simulate_to
from asfm.results.report import RunSummary
from asfm.stages import Progress, no_progress

SCENE = "seafloor"


def run_demo(output: Path, frames: int = DEFAULT_FRAMES, progress: Progress = no_progress) -> RunSummary:
    """Simulate boulders on a seafloor into output/seafloor and reconstruct them into output/results.

    An earlier demo in the same place is replaced; anything else is left alone.

    Raises:
        AsfmError: fewer than one frame, or a folder cannot be written.
    """
    simulate_to(SCENE, output / SCENE, frames=frames, overwrite=True, progress=progress)
    return run_sequence(output / SCENE, output / "results", overwrite=True, progress=progress)
