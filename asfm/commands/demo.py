"""Command ``asfm demo``: simulate, reconstruct and evaluate a sequence."""

from pathlib import Path

from asfm.commands.run import run_sequence
from asfm.commands.simulate import SimulationOptions, simulate_to
from asfm.results.run_summary import RunSummary
from asfm.stages import Progress, no_progress

SCENE = "seafloor"


def run_demo(output: Path, frames: int = 80, progress: Progress = no_progress) -> RunSummary:
    """Simulate boulders on a seafloor into output/seafloor and reconstruct them into output/results.

    Both folders of an earlier demo are replaced; other files are not touched.

    Raises:
        AsfmError: fewer than one frame, or a folder cannot be written.
    """
    simulate_to(SCENE, output / SCENE, SimulationOptions(frames=frames), overwrite=True, progress=progress)
    return run_sequence(output / SCENE, output / "results", overwrite=True, progress=progress)
