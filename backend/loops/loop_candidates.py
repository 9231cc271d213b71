"""Loop candidates: frames far apart in time whose fields of view overlap under the estimated poses and covariances."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.relative_covariance import joint_covariance, predict_sigma
from asfm.config import LoopsConfig
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, IntArray

MAX_FRAMES = 120
"""Loops are searched among at most this many frames, evenly spread, to bound the cost."""
TYPICAL_RANGE_SHARE = 0.6
"""Share of the maximum range at which a pair's uncertainty is predicted: where most sonars see the bottom."""
FRUSTUM_SAMPLES = (4, 5, 3)
"""Ranges, bearings and elevations at which the field of view is sampled."""


@dataclass(frozen=True)
class LoopPair:
    """Two frames that should see the same scene."""

    frame_a: int
    frame_b: int
    overlap: float
    """Share of frame a's field of view that frame b sees, or may see given the uncertainty of its pose."""
    range_sigma_m: float
    """Standard deviation of the range at which frame b is predicted to see frame a's points."""
    bearing_sigma_rad: float
    """The same for the bearing."""


@dataclass(frozen=True)
class LoopSearch:
    """The frames among which loops are searched, and the candidate pairs."""

    frames: IntArray
    """(F,) numbers of frames, rising."""
    pairs: dict[tuple[int, int], LoopPair]
    """By their frames (a, b), a before b."""


def search_loops(solution: Solution, sequence: Sequence, settings: LoopsConfig, window: int) -> LoopSearch:
    """Find pairs of frames beyond the window that overlap and share few landmarks.

    Pairs on both sides of a step that neither odometry nor tracks determine are excluded: the length of that step is
    only assumed, and a similar place could be taken for the same one.

    Args:
        solution: poses, landmarks and the graph, from which the covariance of the poses follows.
        sequence: gives the sonar and its lever arm.
        settings: section ``loops``.
        window: frames at most this far apart have been matched already.
    """
    count = len(sequence)
    frames = np.unique(np.linspace(0, count - 1, min(count, MAX_FRAMES)).round().astype(np.int64))
    candidate = frames[None] - frames[:, None] > window
    candidate &= ~_share_landmarks(solution, frames, count, settings.max_shared)
    segment = _label_segments(solution, sequence, settings.min_matches)[frames]
    candidate &= segment[None] == segment[:, None]
    if not candidate.any():
        return LoopSearch(frames, {})
    poses = solution.bundle.world_from_vehicle[frames]
    covariance = settings.sigma_factor**2 * joint_covariance(solution.bundle, frames)
    range_m = TYPICAL_RANGE_SHARE * float(sequence.sonar.range_edges_m[-1])
    sigma = predict_sigma(covariance, poses, sequence.vehicle_from_sonar, range_m)
    margin = np.stack([sigma.range_m, sigma.bearing_rad, sigma.elevation_rad], axis=-1)
    overlap = _pairwise_overlap(poses @ sequence.vehicle_from_sonar, candidate, margin, sequence.sonar)
    pairs = {}
    for a, b in np.argwhere(candidate & (overlap >= settings.min_overlap)):
        key = int(frames[a]), int(frames[b])
        pairs[key] = LoopPair(*key, float(overlap[a, b]), float(sigma.range_m[a, b]), float(sigma.bearing_rad[a, b]))
    return LoopSearch(frames, pairs)


def choose_pairs(search: LoopSearch, settings: LoopsConfig, window: int) -> list[LoopPair]:
    """Choose the pair of the largest overlap from each cell of the plane of frame pairs.

    The cells are squares with a side of half a window, enlarged until their number is within ``loops.max_pairs``, so
    that the chosen pairs are spread evenly.

    Args:
        search: candidate pairs.
        settings: section ``loops``.
        window: in frames.
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
    """Return the candidate pairs of the frames just before and after those of a pair, among the searched frames."""
    a, b = np.searchsorted(search.frames, [pair.frame_a, pair.frame_b]).tolist()
    steps = ((-1, -1), (1, 1), (-1, 1), (1, -1))
    inside = [(a + i, b + j) for i, j in steps if 0 <= a + i < b + j < len(search.frames)]
    keys = [(int(search.frames[i]), int(search.frames[j])) for i, j in inside]
    return [search.pairs[key] for key in keys if key in search.pairs]


def _share_landmarks(solution: Solution, frames: IntArray, frame_count: int, max_shared: int) -> BoolArray:
    """Return which (F, F) pairs of frames share more than a number of landmarks."""
    used = solution.observed
    row_of_frame = np.full(frame_count, -1)
    row_of_frame[frames] = np.arange(len(frames))
    row, column = row_of_frame[solution.tracks.frame[used]], solution.tracks.track[used]
    kept = row >= 0
    visibility = csr_matrix(
        (np.ones(int(kept.sum())), (row[kept], column[kept])), shape=(len(frames), max(solution.tracks.count, 1))
    )
    return np.asarray((visibility @ visibility.T).toarray() > max_shared)


def _label_segments(solution: Solution, sequence: Sequence, min_landmarks: int) -> IntArray:
    """Return the (N,) number of the segment of each frame; segments are separated by undetermined steps.

    A step is determined by odometry, or by enough landmarks that were used both before and after it. The required
    number is that of a loop's matches: otherwise a wrong loop would outweigh the step.
    """
    count, tracks, sensors = len(sequence), solution.tracks, solution.problem.sensors
    used = solution.observed & solution.bundle.in_graph[tracks.track]
    first, last = tracks.frame_span(used)
    change = np.bincount(first, minlength=count) - np.bincount(last, minlength=count)
    known = np.cumsum(change)[:-1] >= min_landmarks
    known |= sensors.known_steps(sequence.noise)
    return np.concatenate([[0], np.cumsum(~known)])


def _pairwise_overlap(
    world_from_sonar: FloatArray, candidate: BoolArray, margin: FloatArray, sonar: SonarModel
) -> FloatArray:
    """Return the (F, F) overlap of (F, F) candidate pairs under (F, F, 3) margins; zero elsewhere."""
    overlap = np.zeros(candidate.shape)
    for a in np.flatnonzero(candidate.any(axis=1)).tolist():
        others = np.flatnonzero(candidate[a])
        overlap[a, others] = _overlap(world_from_sonar[a], world_from_sonar[others], margin[a, others], sonar)
    return overlap


def _overlap(
    world_from_a: FloatArray, world_from_others: FloatArray, margin: FloatArray, sonar: SonarModel
) -> FloatArray:
    """Return the share (M,) of one field of view that M others see, widened by (M, 3) margins.

    The margins are of range in metres, bearing and elevation in radians.
    """
    half = sonar.elevation_aperture_rad / 2
    edges = (sonar.range_edges_m, sonar.bearing_edges_rad, np.array([-half, half]))
    axes = [
        edge[0] + (edge[-1] - edge[0]) * (np.arange(count) + 0.5) / count
        for edge, count in zip(edges, FRUSTUM_SAMPLES, strict=True)
    ]
    in_world = transform(world_from_a, back_project(*np.meshgrid(*axes, indexing="ij")).reshape(-1, 3))
    seen = project(transform(invert(world_from_others)[:, None], in_world))
    inside = np.ones(seen[0].shape, dtype=bool)
    for value, edge, beyond in zip(seen, edges, margin.T, strict=True):
        inside &= (value >= edge[0] - beyond[:, None]) & (value <= edge[-1] + beyond[:, None])
    return np.asarray(inside.mean(axis=1))
