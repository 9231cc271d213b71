"""Loops: pairs of frames far apart in time that should see the same, by their poses and how sure those are."""

from dataclasses import dataclass

import numpy as np

from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.relative_covariance import joint_covariance, predict_sigma
from asfm.config import LoopsConfig
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, IntArray

MAX_FRAMES = 120
"""Loops are looked for among this many frames, evenly spread: what the search costs is bounded."""
REACH_SHARE = 0.6
"""Share of the greatest range at which a pair's uncertainty is told: where most sonars look at the bottom."""
SAMPLES = (4, 5, 3)
"""Ranges, bearings and elevations at which a frustum is sampled."""


@dataclass(frozen=True)
class LoopPair:
    """Two frames that should see the same."""

    frame_a: int
    frame_b: int
    overlap: float
    """Share of frame a's frustum that frame b sees, or may see."""
    range_sigma_m: float
    """Standard deviation of where frame b is predicted to see frame a's points."""
    bearing_sigma_rad: float


@dataclass(frozen=True)
class LoopSearch:
    """The frames among which loops are looked for, and all pairs of them that qualify."""

    frames: IntArray
    """(F,) rising."""
    pairs: dict[tuple[int, int], LoopPair]
    """By frames (a, b), a before b."""


def search_loops(solution: Solution, sequence: Sequence, settings: LoopsConfig, window: int) -> LoopSearch:
    """Find the pairs of frames beyond the window that overlap and that few landmarks join yet.

    No pair reaches across a step that neither odometry nor tracks know: how far it went is a guess there, and a place
    that looks alike may lie wherever the guess allows the same one to be.

    Args:
        solution: poses, landmarks and their graph, which tells the poses' covariance.
        sequence: the sonar.
        settings: section ``loops``.
        window: frames closer than this have been matched already.
    """
    count = len(sequence)
    frames = np.unique(np.linspace(0, count - 1, min(count, MAX_FRAMES)).round().astype(np.int64))
    apart = frames[None] - frames[:, None] > window
    apart &= ~_are_joined(solution, frames, count, settings.max_shared)
    piece = _number_pieces(solution, sequence, settings.min_matches)[frames]
    apart &= piece[None] == piece[:, None]
    if not apart.any():
        return LoopSearch(frames, {})
    poses = solution.bundle.world_from_vehicle[frames]
    covariance = settings.sigma_factor**2 * joint_covariance(solution.bundle, frames)
    reach_m = REACH_SHARE * float(sequence.sonar.range_edges_m[-1])
    sigma = predict_sigma(covariance, poses, sequence.vehicle_from_sonar, reach_m)
    overlap = np.zeros(apart.shape)
    world_from_sonar = poses @ sequence.vehicle_from_sonar
    for a in np.flatnonzero(apart.any(axis=1)).tolist():
        others = np.flatnonzero(apart[a])
        margin = np.stack([part[a, others] for part in (sigma.range_m, sigma.bearing_rad, sigma.elevation_rad)], axis=1)
        overlap[a, others] = _overlap(world_from_sonar[a], world_from_sonar[others], margin, sequence.sonar)
    chosen = np.argwhere(apart & (overlap >= settings.min_overlap))
    pairs = {
        (int(frames[a]), int(frames[b])): LoopPair(
            int(frames[a]),
            int(frames[b]),
            float(overlap[a, b]),
            float(sigma.range_m[a, b]),
            float(sigma.bearing_rad[a, b]),
        )
        for a, b in chosen
    }
    return LoopSearch(frames, pairs)


def choose_pairs(search: LoopSearch, settings: LoopsConfig, window: int) -> list[LoopPair]:
    """Choose the pair of the largest overlap from each cell of the plane of frame pairs.

    The cells are squares of half a window, or as much larger as keeps their number within ``loops.max_pairs``: few
    loops are looked at closely, and many evenly.
    """
    size = max(window // 2, 1)
    while True:
        best: dict[tuple[int, int], LoopPair] = {}
        for pair in search.pairs.values():
            cell = (pair.frame_a // size, pair.frame_b // size)
            if cell not in best or pair.overlap > best[cell].overlap:
                best[cell] = pair
        if len(best) <= settings.max_pairs:
            return list(best.values())
        size += 1


def find_neighbours(search: LoopSearch, pair: LoopPair) -> list[LoopPair]:
    """Give the pairs whose frames come just before and after both of a pair's."""
    a, b = np.searchsorted(search.frames, [pair.frame_a, pair.frame_b]).tolist()
    steps = ((-1, -1), (1, 1), (-1, 1), (1, -1))
    inside = [(a + i, b + j) for i, j in steps if 0 <= a + i < b + j < len(search.frames)]
    keys = [(int(search.frames[i]), int(search.frames[j])) for i, j in inside]
    return [search.pairs[key] for key in keys if key in search.pairs]


def _are_joined(solution: Solution, frames: IntArray, frame_count: int, most: int) -> BoolArray:
    """Tell which pairs of frames share more than so many landmarks: (F, F)."""
    from scipy.sparse import csr_matrix

    used = solution.observed
    place = np.full(frame_count, -1)
    place[frames] = np.arange(len(frames))
    row, column = place[solution.tracks.frame[used]], solution.tracks.track[used]
    kept = row >= 0
    sees = csr_matrix(
        (np.ones(int(kept.sum())), (row[kept], column[kept])), shape=(len(frames), max(solution.tracks.count, 1))
    )
    return np.asarray((sees @ sees.T).toarray() > most)


def _number_pieces(solution: Solution, sequence: Sequence, least: int) -> IntArray:
    """Number the pieces (N,) of a trajectory that unknown steps cut it into.

    A step from a frame to the next is known when odometry measured it, or when so many landmarks bridge it, used both
    before and after: a chain must rest on as much as a loop, or it is the chain that yields to a wrong one.
    """
    count, tracks, sensors = len(sequence), solution.tracks, solution.problem.sensors
    used = solution.observed & solution.bundle.in_graph[tracks.track]
    first, last = tracks.frame_span(used)
    change = np.bincount(first, minlength=count) - np.bincount(last, minlength=count)
    known = np.cumsum(change)[:-1] >= least
    known |= sensors.known_steps(sequence.noise)
    return np.concatenate([[0], np.cumsum(~known)])


def _overlap(
    world_from_a: FloatArray, world_from_others: FloatArray, margin: FloatArray, sonar: SonarModel
) -> FloatArray:
    """Share (M,) of one frustum that others see, widened by (M, 3) margins of range, bearing and elevation."""
    half = sonar.elevation_aperture_rad / 2
    edges = (sonar.range_edges_m, sonar.bearing_edges_rad, np.array([-half, half]))
    axes = [
        side[0] + (side[-1] - side[0]) * (np.arange(count) + 0.5) / count
        for side, count in zip(edges, SAMPLES, strict=True)
    ]
    in_world = transform(world_from_a, back_project(*np.meshgrid(*axes, indexing="ij")).reshape(-1, 3))
    seen = project(transform(invert(world_from_others)[:, None], in_world))
    inside = np.ones(seen[0].shape, dtype=bool)
    for value, side, beyond in zip(seen, edges, margin.T, strict=True):
        inside &= (value >= side[0] - beyond[:, None]) & (value <= side[-1] + beyond[:, None])
    return np.asarray(inside.mean(axis=1))
