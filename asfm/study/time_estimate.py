"""Estimate of a study's time, for a look at its grid before it is run."""

from collections.abc import Iterable
from dataclasses import dataclass

from asfm.datasets import open_sequence
from asfm.frame_selection import choose_frames
from asfm.study.cell import Cell, Recording, Simulation

SCENE_S, RENDER_S = 6.0, 0.10
"""Seconds to build a scene, and to render one of its frames."""
FEATURES_S, CHAIN_S = 0.07, 0.006
"""Seconds a frame for features, candidates and one filter chain, and for each further chain."""
BACKEND_S = {"sonar": 0.25, "odometry": 0.15, "all": 0.15}
"""Seconds a frame for the reconstruction, by mode."""
DRAW_S = 0.05
"""Seconds a frame for one draw of the bound."""


@dataclass(frozen=True)
class Estimate:
    """Numbers of a grid."""

    cells: int
    sequences: int
    """Different simulated sequences and recordings."""
    features: int
    """Passes of a front-end."""
    hours: float
    """Of one core; measured once on one machine with the default sonar, so that a factor of two is no surprise."""


def estimate_time(cells: Iterable[Cell]) -> Estimate:
    """Estimate the time of a grid on one core, without the time of external functions."""
    listed = list(cells)
    lengths = {source: _count_frames(source, listed) for source in {cell.sequence for cell in listed}}
    simulated = {
        cell.sequence_key: SCENE_S + RENDER_S * lengths[cell.sequence]
        for cell in listed
        if isinstance(cell.sequence, Simulation)
    }
    chains: dict[str, dict[tuple[object, ...], int]] = {}
    for cell in listed:
        if cell.external is None and cell.corruption is None:
            chain = (cell.config.matching.filters, cell.mode == "sonar")
            chains.setdefault(cell.features_key, {})[chain] = lengths[cell.sequence]
    seconds = sum(simulated.values())
    for found in chains.values():
        seconds += next(iter(found.values())) * (FEATURES_S + CHAIN_S * (len(found) - 1))
    for cell in listed:
        draws = cell.bound_draws if isinstance(cell.sequence, Simulation) else 0
        seconds += lengths[cell.sequence] * (BACKEND_S[cell.mode] + DRAW_S * draws)
    return Estimate(len(listed), len({cell.sequence_key for cell in listed}), len(chains), seconds / 3600)


def _count_frames(source: Recording | Simulation, cells: list[Cell]) -> int:
    if isinstance(source, Simulation):
        return source.frames
    config = next(cell.config for cell in cells if cell.sequence == source)
    return len(choose_frames(open_sequence(source.path), config.frames))
