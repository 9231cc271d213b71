"""Runs of plausible mistakes: no result may be much worse than what the right sensors give without a word."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from asfm.commands.text import align
from asfm.config import Config
from asfm.config_file import load_config
from asfm.datasets.plausibility import check_plausibility
from asfm.errors import AsfmError
from asfm.evaluation.pose_error_table import ATE_RMSE, evaluate_sequence
from asfm.pipeline.reconstruction import reconstruct
from asfm.sequence import Sequence
from asfm.types import Reconstruction
from tools.benchmark.mistakes import MISTAKES, Mistake
from tools.benchmark.runs import SONAR_ALONE
from tools.benchmark.table import Requirement

SENSOR_MODES: dict[str, tuple[str, ...]] = {
    "all sensors": (),
    "odometry": ("backend.use_navigation=false",),
    "depth and attitude": ("backend.use_odometry=false",),
    "sonar alone": SONAR_ALONE,
}
"""Settings of each mode."""
SENSORS: dict[str, frozenset[str]] = {
    "all sensors": frozenset({"images", "odometry", "navigation"}),
    "odometry": frozenset({"images", "odometry"}),
    "depth and attitude": frozenset({"images", "navigation"}),
    "sonar alone": frozenset({"images"}),
}
MISTAKE_SCENES = ("seafloor", "pier")
"""Scenes of the sequences in which the mistakes are made."""
MAX_RATIO = 1.5
"""A worse result than this many times that of the right sensors must not be silent."""


@dataclass(frozen=True)
class Outcome:
    """One run: its error and its diagnostics."""

    ate_m: float
    """RMSE after SE(3) alignment; infinite where the input was refused."""
    codes: frozenset[str]
    """Codes of its warnings; "refused" where it was."""


@dataclass(frozen=True)
class Cell:
    """One mistake in one mode, beside what the right sensors give."""

    mistake: str
    mode: str
    outcome: Outcome
    right: Outcome
    """The same mode without the mistake."""
    reference_ate_m: float
    """What the sensors that are right give alone."""

    @property
    def new_codes(self) -> frozenset[str]:
        """What is said that is not said of the right recording."""
        return self.outcome.codes - self.right.codes

    @property
    def silent_and_wrong(self) -> bool:
        """Whether the result is clearly worse than that of the right sensors, and nothing says so."""
        return not self.new_codes and self.outcome.ate_m > MAX_RATIO * self.reference_ate_m


def hold_images(sequence: Sequence) -> Sequence:
    """Read all images once, so that they are not rendered again for every run."""
    frames = list(sequence)
    return replace(sequence, read_frame=frames.__getitem__)


def measure(sequence: Sequence, mode: str) -> Outcome:
    """Run a sequence in a mode."""
    settings = SENSOR_MODES[mode]
    try:
        checked = check_plausibility(Path(sequence.name), sequence)
        found = reconstruct(checked, load_config(None, settings) if settings else Config()).reconstruction
    except AsfmError:
        return Outcome(np.inf, frozenset({"refused"}))
    diagnostics = (*checked.diagnostics, *found.diagnostics)
    codes = frozenset(item.code for item in diagnostics if item.severity != "info")
    return Outcome(_position_error(sequence, found), codes)


def _position_error(sequence: Sequence, found: Reconstruction) -> float:
    return evaluate_sequence(sequence, found.trajectory).row(ATE_RMSE).value


def compare_mistakes(
    sequence: Sequence, modes: tuple[str, ...], mistakes: tuple[Mistake, ...] = MISTAKES
) -> Iterator[Cell]:
    """Run all mistakes that touch a sensor of each mode.

    Args:
        sequence: a right one, with odometry, depth, attitude and truth.
        modes: keys of :data:`SENSOR_MODES`.
        mistakes: those to make.
    """
    rights = cache(partial(measure, sequence))
    odometry_m = evaluate_sequence(sequence, sequence.odometry).row(ATE_RMSE).value if sequence.odometry else np.inf
    for mode in modes:
        for mistake in mistakes:
            wrong = {sensor for sensor in ("images", "odometry", "navigation") if sensor in mistake.wrong}
            if not wrong & SENSORS[mode] or (mode == "sonar alone" and mistake.about_geometry):
                continue  # nothing that this mode uses is wrong; or the sonar alone cannot know its own geometry
            reference_m = _reference(SENSORS[mode] - wrong, rights, odometry_m)
            yield Cell(mistake.name, mode, measure(mistake.apply(sequence), mode), rights(mode), reference_m)


def _reference(right: frozenset[str], rights: Callable[[str], Outcome], odometry_m: float) -> float:
    """Return the error that the sensors that are right reach together, or the odometry's own without images."""
    for mode, sensors in SENSORS.items():
        if right == sensors:
            return rights(mode).ate_m
    return odometry_m if "odometry" in right else 0.0


def tabulate_cells(name: str, cells: list[Cell]) -> list[str]:
    """Return the lines of a table of cells of one sequence."""
    rows = [("mistake", "sensors", "ATE m", "right", "others", "", "says")]
    for cell in cells:
        mark = "SILENT" if cell.silent_and_wrong else ""
        ate, right, others = (f"{value:.3f}" for value in (cell.outcome.ate_m, cell.right.ate_m, cell.reference_ate_m))
        rows.append((cell.mistake, cell.mode, ate, right, others, mark, ", ".join(sorted(cell.new_codes))))
    return [name, *align(rows, numbers=(2, 3, 4))]


def list_mistake_numbers(cells: list[Cell]) -> list[Requirement]:
    """List how many cells there are and how many are wrong without a word."""
    silent = sum(cell.silent_and_wrong for cell in cells)
    return [
        Requirement("mistakes x modes", float(len(cells)), at_least=40),
        Requirement("worse than 1.5 x the right sensors, and silent", float(silent), at_most=0),
        Requirement("named", float(sum(bool(cell.new_codes) for cell in cells))),
    ]
