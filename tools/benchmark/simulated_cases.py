"""The simulated sequences that the back-end is measured on, each made once and kept, for ``benchmark.py``."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asfm.datasets.native.writer import write_native
from asfm.simulation.scenes.catalogue import SCENES
from asfm.simulation.simulate import find_sonar, simulate
from asfm.simulation.vehicle.trajectories import find_motion
from asfm.types import Trajectory

SEEN = ("seafloor", "pier", "hull")
SONARS = ("oculus_m750d_high", "oculus_m750d_low")
"""70 and 130 degrees of beams."""
NARROW, NARROW_MOTION = ("seafloor", "didson"), "transect"
"""Scene, sonar and motion of the runs whose frames overlap too little: 96 beams over 29 degrees, swaying sideways."""
SPEED_FACTORS = (4.0, 8.0, 12.0)
"""How many times as fast as usual that goes: the first is followed well, the second partly, the third is lost. On the
spot, a lost run would look good: a sway goes a long way and never far."""


@dataclass(frozen=True)
class Case:
    """One sequence to simulate."""

    scene: str
    sonar: str
    seed: int
    frames: int
    motion: str = ""
    """The scene's usual one without a name."""
    speed_factor: float = 1.0
    """How many times as fast as the motion usually is."""

    @property
    def name(self) -> str:
        """Name of the sequence's folder; different cases have different ones."""
        motion = f"-{self.motion}" if self.motion else ""
        speed_factor = "" if self.speed_factor == 1 else f"-{self.speed_factor:g}x"
        return f"{self.scene}-{self.sonar}{motion}{speed_factor}-{self.frames}f-seed{self.seed}"


def list_cases(scenes: Iterable[str], sonars: Iterable[str], seeds: int, frames: int) -> list[Case]:
    """List every scene before every sonar with each of the seeds 0..seeds-1."""
    sonars = tuple(sonars)
    return [Case(scene, sonar, seed, frames) for scene in scenes for sonar in sonars for seed in range(seeds)]


def list_narrow_cases(seeds: int, frames: int) -> list[Case]:
    """List the narrow sonar at each of its hastes with each of the seeds 0..seeds-1."""
    return [
        Case(*NARROW, seed, frames, NARROW_MOTION, speed_factor)
        for speed_factor in SPEED_FACTORS
        for seed in range(seeds)
    ]


def provide_sequence(case: Case, cache: Path) -> Path:
    """Simulate a sequence where it is not yet in the cache; gives its folder.

    A folder is known by its name alone: after a change of the simulator, throw the cache away.

    Raises:
        AsfmError: unknown scene or sonar, or the folder cannot be written.
    """
    folder = cache / case.name
    if not folder.exists():
        path = (case.motion or None) if case.speed_factor == 1 else _speed_up(case)
        simulated = simulate(case.scene, case.sonar, case.frames, case.seed, path)
        cache.mkdir(parents=True, exist_ok=True)
        write_native(folder, simulated.sequence, truth=simulated.read_truth)
    return folder


def _speed_up(case: Case) -> Trajectory:
    """Take the motion several times as fast."""
    sonar, recipe = find_sonar(case.sonar).sonar, SCENES[case.scene]
    stamps_s = np.arange(case.frames) / sonar.rate_hz
    view = recipe.look(sonar.range_max)
    poses = find_motion(case.motion or recipe.motion)(
        view, case.speed_factor * stamps_s, np.random.default_rng(case.seed)
    )
    return Trajectory(stamps_s, poses)
