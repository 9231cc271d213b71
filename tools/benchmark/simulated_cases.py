"""Simulated sequences on which the back-end is measured, each simulated once and cached."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asfm.datasets.native.writer import write_native
from asfm.simulation.scenes.catalogue import SCENES
from asfm.simulation.simulate import find_sonar, simulate
from asfm.simulation.vehicle.trajectories import find_motion
from asfm.types import Trajectory

SCENE_NAMES = ("seafloor", "pier", "hull")
SONAR_NAMES = ("oculus_m750d_high", "oculus_m750d_low")
"""Fields of view of 70 and 130 degrees."""
NARROW, NARROW_MOTION = ("seafloor", "didson"), "transect"
"""Scene, sonar and motion of sequences whose frames overlap too little: 96 beams over 29 degrees, moving sideways."""
SPEED_FACTORS = (4.0, 8.0, 12.0)
"""Speeds of that motion over its usual one: the first is tracked well, the second partly, the third is lost. A transect
and not a sway, which stays near its start, so that the position error of a lost run would be small."""


@dataclass(frozen=True)
class Case:
    """One sequence to simulate."""

    scene: str
    sonar: str
    seed: int
    frames: int
    motion: str = ""
    """Empty for the scene's default motion."""
    speed_factor: float = 1.0
    """Speed over the motion's usual one."""

    @property
    def name(self) -> str:
        """Name of the sequence's folder, unique to the case."""
        motion = f"-{self.motion}" if self.motion else ""
        speed_factor = "" if self.speed_factor == 1 else f"-{self.speed_factor:g}x"
        return f"{self.scene}-{self.sonar}{motion}{speed_factor}-{self.frames}f-seed{self.seed}"


def list_cases(scenes: Iterable[str], sonars: Iterable[str], seeds: int, frames: int) -> list[Case]:
    """List the cases of every scene, every sonar and the seeds 0..seeds-1."""
    sonars = tuple(sonars)
    return [Case(scene, sonar, seed, frames) for scene in scenes for sonar in sonars for seed in range(seeds)]


def list_narrow_cases(seeds: int, frames: int) -> list[Case]:
    """List the cases of the narrow sonar with every speed factor and the seeds 0..seeds-1."""
    return [
        Case(*NARROW, seed, frames, NARROW_MOTION, speed_factor)
        for speed_factor in SPEED_FACTORS
        for seed in range(seeds)
    ]


def provide_sequence(case: Case, cache: Path) -> Path:
    """Simulate a sequence unless it is in the cache, and return its folder.

    A folder is identified by its name alone: delete the cache after a change of the simulator.

    Raises:
        AsfmError: unknown scene or sonar, or the folder cannot be written.
    """
    folder = cache / case.name
    if not folder.exists():
        motion = (case.motion or None) if case.speed_factor == 1 else _speed_up(case)
        simulated = simulate(case.scene, case.sonar, case.frames, case.seed, motion)
        cache.mkdir(parents=True, exist_ok=True)
        write_native(folder, simulated.sequence, truth=simulated.read_truth)
    return folder


def _speed_up(case: Case) -> Trajectory:
    """Return the motion of a case at its speed factor."""
    sonar, recipe = find_sonar(case.sonar).sonar, SCENES[case.scene]
    stamps_s = np.arange(case.frames) / sonar.rate_hz
    view = recipe.look(sonar.range_max)
    poses = find_motion(case.motion or recipe.motion)(
        view, case.speed_factor * stamps_s, np.random.default_rng(case.seed)
    )
    return Trajectory(stamps_s, poses)
