"""Command ``asfm simulate``: simulate a sequence with ground truth and write it as a folder."""

from dataclasses import dataclass
from pathlib import Path

from asfm.datasets.native.writer import write_native
from asfm.datasets.tables import read_tum
from asfm.errors import AsfmError, quote
from asfm.regular_file import is_present
from asfm.sequence import Sequence
from asfm.stages import Progress, no_progress
from asfm.types import Trajectory

FORMATS = ("native", "holoocean")


@dataclass(frozen=True)
class SimulationOptions:
    """Sonar, length, motion and output format of a simulated sequence."""

    sonar: str = "oculus_m750d_high"
    """Name of a sonar preset, or a HoloOcean scenario (.json)."""
    frames: int = 80
    """Number of frames; fewer where a given path ends earlier."""
    seed: int = 0
    """Random seed; equal seeds give identical files."""
    motion: str | None = None
    """Name of a motion, or a TUM file of world_from_vehicle; the usual motion of the scene where it is None."""
    format_name: str = "native"
    """Output format: "native", or "holoocean" (pickles with images and true poses only)."""


def simulate_to(
    scene: str,
    output: Path,
    options: SimulationOptions | None = None,
    overwrite: bool = False,
    progress: Progress = no_progress,
) -> Sequence:
    """Simulate a scene and write it, frame by frame, as a folder with ground truth.

    Args:
        scene: name of a scene, or a mesh file.
        output: the folder, which appears only when it is complete.
        options: sonar, length, motion and format; the defaults where it is None.
        overwrite: replace an existing sequence.
        progress: receives the number of frames written.

    Raises:
        AsfmError: the scene, sonar, motion or format is unknown, a number is out of range, or the folder cannot be
            written.
    """
    from asfm.simulation.holoocean_writer import write_pickles  # loads the ray caster
    from asfm.simulation.simulate import simulate

    options = options or SimulationOptions()
    if options.format_name not in FORMATS:
        raise AsfmError(f"unknown format {quote(options.format_name)} to write; known: {', '.join(FORMATS)}")
    simulated = simulate(scene, options.sonar, options.frames, options.seed, _read_motion(options.motion))

    def report(done: int, total: int) -> None:
        progress("simulate", done, total)

    if options.format_name == "native":
        write_native(output, simulated.sequence, truth=simulated.read_truth, overwrite=overwrite, progress=report)
    else:
        write_pickles(output, simulated, overwrite, report)
    return simulated.sequence


def _read_motion(motion: str | None) -> str | Trajectory | None:
    """Return the trajectory where ``motion`` is a file; names of motions have no suffix and are not files."""
    from asfm.simulation.vehicle.trajectories import MOTIONS

    if motion is None or motion in MOTIONS:
        return motion
    path = Path(motion)
    if is_present(path) and path.is_dir():
        raise AsfmError(f"{path}: expected a motion's name or a path in TUM format, found a folder")
    return read_tum(path) if path.suffix or is_present(path) else motion
