"""``asfm simulate``: a scene becomes a sequence with truth."""

from pathlib import Path

from asfm.datasets.native_writer import write_native
from asfm.sequence import Sequence
from asfm.stages import Progress, no_progress

DEFAULT_SONAR = "oculus_m750d_high"
DEFAULT_FRAMES = 80


def simulate_to(
    scene: str,
    output: Path,
    sonar: str = DEFAULT_SONAR,
    frames: int = DEFAULT_FRAMES,
    seed: int = 0,
    overwrite: bool = False,
    progress: Progress = no_progress,
) -> Sequence:
    """Simulate a scene and write it as a native folder with truth, frame by frame.

    Args:
        scene: name of a scene.
        output: the folder, which appears only when it is whole.
        sonar: name of a sonar.
        frames: how many.
        seed: the same one gives the same bytes.
        overwrite: replace a sequence that is there.
        progress: told how many frames are written.

    Raises:
        AsfmError: unknown scene or sonar, an impossible number, or the folder cannot be written.
    """
    from asfm.simulation.simulate import simulate  # loads what casts rays

    simulated = simulate(scene, sonar, frames, seed)
    write_native(
        output,
        simulated.sequence,
        truth=simulated.read_truth,
        overwrite=overwrite,
        progress=lambda done, total: progress("simulate", done, total),
    )
    return simulated.sequence
