"""Search of partially mirrored solutions: reflections at a grid of frames, each relaxed by dense bundle adjustment.

A reflection alone says little, since the stretch over which the image changes extends over many frames: it must be
relaxed before its fit can be compared. Dense adjustments of the longest tracks are fast enough to try many frames.
"""

from dataclasses import dataclass, replace

import numpy as np

from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.dense_bundle import DenseBundle, adjust_dense
from asfm.backend.graph.dense_problem import DenseProblem, empty_problem, number_problem, scale_sigmas
from asfm.backend.graph.factors import CAUCHY_SIGMAS
from asfm.geometry.poses import invert, transform
from asfm.geometry.reflection import REFLECTION, reflection_at
from asfm.types import BoolArray, FloatArray, IntArray

FRAME_STRIDE, MAX_FRAMES = 8, 40
"""Frames from one tested reflection to the next, more where there would be too many."""
MIN_FRAMES_TO_END = 7
"""Frames before the first and after the last one that is tested: fewer tell little, and change little."""
REACH = 60
"""Frames to each side of a reflection that are adjusted."""
MAX_TRACKS = 140
"""Tracks by which a reflection is tested: those that extend farthest to both sides."""
MIN_VIEWS = 3
"""Shorter tracks are not used."""
STEP_FACTOR = 2.0
"""Standard deviation of a step in the adjustments over that in the graph."""
FIRST_SIGMA_SCALE, ITERATIONS = 3.0, 12
"""Factor of the sigmas in the first of two adjustments after a reflection, and steps of each at most."""


@dataclass(frozen=True)
class OtherOptimum:
    """Poses relaxed after the reflection of those behind a frame."""

    frame: int | None
    """Last one that was not reflected; None where none was."""
    world_from_sonar: FloatArray
    """(N, 4, 4) relaxed poses."""
    gain: float
    """Cost of the poses without reflection, relaxed, less that of these: half sums of robust squares."""


@dataclass(frozen=True)
class _Window:
    """Frames that are adjusted, and the frame in it by which tracks are chosen."""

    first: int
    middle: int
    last: int

    @staticmethod
    def around(frame: int | None, count: int) -> "_Window":
        """Return the window around a frame, or that of all (N,) frames."""
        if frame is None:
            return _Window(0, count // 2, count - 1)
        return _Window(max(0, frame + 1 - REACH), frame, min(count - 1, frame + REACH))


def search_other_optima(solution: Solution) -> list[OtherOptimum]:
    """Reflect the poses after each of several frames, and relax those around it.

    Where all frames fit into one adjustment, the poses are relaxed without a reflection too.

    Args:
        solution: converged, of N frames.

    Returns:
        One for each tested frame, the largest gain first; none of a sonar that stands still.
    """
    count, still = len(solution.bundle.world_from_vehicle), solution.problem.sensors.standstill
    if still is not None and still.all():
        return []
    stride = max(FRAME_STRIDE, -(-count // MAX_FRAMES))
    grid = range(MIN_FRAMES_TO_END, count - MIN_FRAMES_TO_END, stride)
    moving = [frame for frame in grid if still is None or not still[frame]]
    tried = [_relax_reflected(solution, frame) for frame in [*([None] if count <= 2 * REACH else []), *moving]]
    return sorted((found for found in tried if found is not None), key=lambda found: -found.gain)


def _relax_reflected(solution: Solution, frame: int | None) -> OtherOptimum | None:
    """Relax the poses, reflected after a frame or as they are; None without tracks around the frame."""
    world_from_sonar = solution.bundle.world_from_vehicle @ solution.problem.vehicle_from_sonar
    window = _Window.around(frame, len(world_from_sonar))
    used, behind = _choose_tracks(solution, window)
    if not len(used):
        return None
    dense, frames, points = _number_problem(solution, window, used)
    poses, xyz_m = world_from_sonar[frames], solution.bundle.xyz_m[points]
    before = _adjust(dense, poses, xyz_m)
    found = world_from_sonar.copy()
    if frame is not None:
        reflection = reflection_at(world_from_sonar[frame])
        found[frame + 1 :] = reflection @ found[frame + 1 :] @ REFLECTION
        xyz_m = np.where(behind[points][:, None], transform(reflection, xyz_m), xyz_m)
    wide = _adjust(scale_sigmas(dense, FIRST_SIGMA_SCALE), found[frames], xyz_m)
    after = _adjust(dense, wide.world_from_sonar, wide.xyz_m)
    return OtherOptimum(frame, _join(found, frames, after.world_from_sonar), before.cost - after.cost)


def _number_problem(solution: Solution, window: _Window, used: IntArray) -> tuple[DenseProblem, IntArray, IntArray]:
    """Return the dense problem of (U,) observations, its (F,) frames and its (P,) tracks."""
    problem = solution.problem
    step_sigma = STEP_FACTOR * problem.sensors.step_sigma[window.first : window.last].max(axis=0)
    template = replace(empty_problem(problem.half_aperture_rad, step_sigma), cauchy_sigmas=CAUCHY_SIGMAS)
    return number_problem(template, solution.tracks, problem.sigma, used)


def _adjust(problem: DenseProblem, world_from_sonar: FloatArray, xyz_m: FloatArray) -> DenseBundle:
    free = np.arange(len(world_from_sonar)) > 0
    return adjust_dense(problem, world_from_sonar, xyz_m, free, ITERATIONS)


def _choose_tracks(solution: Solution, window: _Window) -> tuple[IntArray, BoolArray]:
    """Return the observations of the chosen tracks, and (T,) which tracks are mostly seen behind the frame."""
    tracks = solution.tracks
    near = solution.bundle.in_graph[tracks.track] & (tracks.frame >= window.first) & (tracks.frame <= window.last)
    before = np.bincount(tracks.track, near & (tracks.frame <= window.middle), minlength=tracks.count)
    behind = np.bincount(tracks.track, near & (tracks.frame > window.middle), minlength=tracks.count)
    ranked = np.lexsort((-(before + behind), -np.minimum(before, behind)))[:MAX_TRACKS]
    chosen = ranked[(before + behind)[ranked] >= MIN_VIEWS]
    return np.flatnonzero(near & np.isin(tracks.track, chosen)), behind > before


def _join(world_from_sonar: FloatArray, frames: IntArray, adjusted: FloatArray) -> FloatArray:
    """Put the (F,) adjusted frames in the place of the given ones; those after them move rigidly with the last."""
    last = int(frames[-1])
    moved = adjusted[-1] @ invert(world_from_sonar[last])
    joined = world_from_sonar.copy()
    joined[last + 1 :] = moved @ joined[last + 1 :]
    joined[frames] = adjusted
    return joined
