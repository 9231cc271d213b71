"""``asfm simulate``: a scene becomes a sequence with truth."""

from pathlib import Path

from asfm.datasets.native.writer import write_native
from asfm.datasets.tables import read_tum
from asfm.errors import AsfmError
from asfm.sequence import Sequence
from asfm.stages import Progress, no_progress
from asfm.types import Trajectory

DEFAULT_SONAR = "oculus_m750d_high"
DEFAULT_FRAMES = 80
FORMATS = ("native", "holoocean")


def simulate_to(
    scene: str,
    output: Path,
    sonar: str = DEFAULT_SONAR,
    frames: int = DEFAULT_FRAMES,
    seed: int = 0,
    overwrite: bool = False,
    progress: Progress = no_progress,
    motion: str | None = None,
    format_name: str = "native",
) -> Sequence:
    """Simulate a scene and write it as a folder with truth, frame by frame.

    Args:
        scene: name of a scene, or a mesh file.
        output: the folder, which appears only when it is whole.
        sonar: name of a sonar, or a HoloOcean scenario (.json).
        frames: how many; fewer where a given path ends before.
        seed: the same one gives the same bytes.
        overwrite: replace a sequence that is there.
        progress: told how many frames are written.
        motion: name of a motion, or a TUM file of the vehicle's path; the scene's usual one by default.
        format_name: "native" holds all that is known; "holoocean", pickles, holds images and true poses only.

    Raises:
        AsfmError: unknown scene, sonar, motion or format, an impossible number, or the folder cannot be written.
    """
    from asfm.simulation.holoocean_writer import write_pickles  # loads what casts rays
    from asfm.simulation.simulate import simulate

    if format_name not in FORMATS:
        raise AsfmError(f"unknown format {format_name!r} to write; known: {', '.join(FORMATS)}")
    simulated = simulate(scene, sonar, frames, seed, _read_motion(motion))

    def tell(done: int, total: int) -> None:
        progress("simulate", done, total)

    if format_name == "native":
        write_native(output, simulated.sequence, truth=simulated.read_truth, overwrite=overwrite, progress=tell)
    else:
        write_pickles(output, simulated, overwrite, tell)
    return simulated.sequence


def _read_motion(motion: str | None) -> str | Trajectory | None:
    """Read the path where a file is meant; a motion's name has no suffix and is not the name of a file."""
    from asfm.simulation.vehicle.trajectories import MOTIONS

    if motion is None or motion in MOTIONS:
        return motion
    path = Path(motion)
    if path.is_dir():
        raise AsfmError(f"{path}: expected a motion's name or a path in TUM format, found a folder")
    return read_tum(path) if path.suffix or path.exists() else motion
