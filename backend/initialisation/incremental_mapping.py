"""Incremental mapping: poses in six degrees of freedom and points, grown frame by frame from tracks alone.

Each frame is first located against the known points (acoustic resection), new points begin at a random elevation in the
beam, and every few frames poses and points are adjusted together with wide sigmas that become narrow. Zero elevation
would be a saddle: by symmetry the cost does not change there with the sign of the elevation.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from asfm.backend.graph.dense_bundle import DenseBundle, adjust_dense
from asfm.backend.graph.dense_problem import DenseProblem, number_problem, scale_sigmas
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import back_project
from asfm.types import BoolArray, FloatArray, IntArray, Tracks

MIN_SHARED = 3
"""Fewest known points of a frame whose pose is estimated."""
FRAMES_PER_ADJUSTMENT = 4
WINDOW = 24
"""Latest frames that move in an adjustment."""
WINDOWS_PER_LONG = 4
"""After so many adjustments many more frames move."""
LONGEST_WINDOW = 150
"""That many: time grows with the third power, memory with the second."""
SIGMA_SCALES = (8.0, 2.0, 1.0)
"""Factors of the sigmas in the passes of an adjustment."""
RESECTION_SCALE = 5.0
"""Factor of the sigmas while a frame is located."""
RESECTION_CAUCHY_SIGMAS = 2.0
"""Scale of the Cauchy kernel in the resection."""
POINT_SIGMA_PER_RANGE = 0.05
"""Standard deviation of a known point while a frame is located, over the sonar's range: it may not be known yet."""
RESECTION_ITERATIONS, ADJUSTMENT_ITERATIONS = 12, 15


@dataclass
class IncrementalMap:
    """Poses and points so far."""

    tracks: Tracks
    sigma: FloatArray
    """(O, 2) standard deviations of the observations."""
    template: DenseProblem
    """Settings of every problem; its arrays are empty."""
    max_range_m: float
    world_from_sonar: FloatArray
    """(N, 4, 4)"""
    xyz_m: FloatArray = field(init=False)
    """(T, 3)"""
    known: BoolArray = field(init=False)
    """(T,) which points have been seen."""

    def __post_init__(self) -> None:
        self.xyz_m = np.zeros((self.tracks.count, 3))
        self.known = np.zeros(self.tracks.count, dtype=bool)


def grow_map(
    tracks: Tracks,
    sigma: FloatArray,
    frame_count: int,
    template: DenseProblem,
    max_range_m: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Estimate sonar poses from tracks, frame by frame.

    Args:
        tracks: (O,) observations of T landmarks.
        sigma: (O, 2) standard deviations of range_m and bearing_rad.
        frame_count: N.
        template: of :func:`empty_problem`.
        max_range_m: of the sonar.
        rng: draws the elevations at which points begin.

    Returns:
        (N, 4, 4) poses, the first one the identity. A frame with too few known points keeps the pose before it.
    """
    still = np.repeat(np.eye(4)[None], frame_count, axis=0)
    grown = IncrementalMap(tracks, sigma, template, max_range_m, still)
    adjustments = 0
    for frame, seen in enumerate(tracks.by_frame(frame_count)):
        if frame:
            grown.world_from_sonar[frame] = grown.world_from_sonar[frame - 1]
            _locate_frame(grown, frame, seen)
        _add_points(grown, frame, seen, rng)
        last = frame == frame_count - 1
        if frame and (last or frame % FRAMES_PER_ADJUSTMENT == 0):
            adjustments += 1
            length = LONGEST_WINDOW if last or adjustments % WINDOWS_PER_LONG == 0 else WINDOW
            _adjust_frames(grown, max(0, frame - length), frame)
    for frame in np.setdiff1d(np.arange(1, frame_count), tracks.frame).tolist():
        grown.world_from_sonar[frame] = grown.world_from_sonar[frame - 1]
    return grown.world_from_sonar


def adjust_narrowing(
    problem: DenseProblem, world_from_sonar: FloatArray, xyz_m: FloatArray, free: BoolArray
) -> DenseBundle:
    """Adjust with wide sigmas that become narrow (graduated non-convexity)."""
    bundle = DenseBundle(world_from_sonar, xyz_m, np.inf)
    for factor in SIGMA_SCALES:
        wide = scale_sigmas(problem, factor)
        bundle = adjust_dense(wide, bundle.world_from_sonar, bundle.xyz_m, free, ADJUSTMENT_ITERATIONS)
    return bundle


def _locate_frame(grown: IncrementalMap, frame: int, seen: IntArray) -> None:
    """Estimate the pose of a frame alone from its (K,) observations of known points (acoustic resection)."""
    seen = seen[grown.known[grown.tracks.track[seen]]]
    if len(seen) < MIN_SHARED:
        return
    problem, _, points = number_problem(grown.template, grown.tracks, grown.sigma, seen)
    problem = replace(
        scale_sigmas(problem, RESECTION_SCALE),
        frame=np.ones(len(seen), dtype=np.int64),
        step_sigma=grown.template.step_sigma,
        elevation_sigma_rad=np.inf,
        point_sigma_m=POINT_SIGMA_PER_RANGE * grown.max_range_m,
        cauchy_sigmas=RESECTION_CAUCHY_SIGMAS,
    )
    start, free = grown.world_from_sonar[[frame - 1, frame]], np.array([False, True])
    found = adjust_dense(problem, start, grown.xyz_m[points], free, RESECTION_ITERATIONS)
    grown.world_from_sonar[frame] = found.world_from_sonar[1]


def _add_points(grown: IncrementalMap, frame: int, seen: IntArray, rng: np.random.Generator) -> None:
    """Place the points that a frame sees first at random elevations."""
    new = seen[~grown.known[grown.tracks.track[seen]]]
    grown.xyz_m[grown.tracks.track[new]] = draw_points(
        grown.tracks, new, grown.world_from_sonar[frame], grown.template.half_aperture_rad, rng
    )
    grown.known[grown.tracks.track[new]] = True


def draw_points(
    tracks: Tracks, chosen: IntArray, world_from_sonar: FloatArray, half_aperture_rad: float, rng: np.random.Generator
) -> FloatArray:
    """Draw points (K, 3) at random elevations of (K,) chosen observations seen from one pose or from (K, 4, 4)."""
    elevation_rad = half_aperture_rad * rng.uniform(-1, 1, len(chosen))
    in_sonar = back_project(tracks.range_m[chosen], tracks.bearing_rad[chosen], elevation_rad)
    return np.asarray(transform(world_from_sonar, in_sonar))


def adjust_in_windows(grown: IncrementalMap, rng: np.random.Generator) -> None:
    """Adjust given poses in long windows that overlap by half, each after the ones before; changes the map."""
    count = len(grown.world_from_sonar)
    seen = grown.tracks.by_frame(count)
    for first in range(0, max(count - LONGEST_WINDOW // 2, 1), LONGEST_WINDOW // 2):
        last = min(first + LONGEST_WINDOW, count) - 1
        for frame in range(first, last + 1):
            _add_points(grown, frame, seen[frame], rng)
        before = grown.world_from_sonar[last].copy()
        _adjust_frames(grown, first, last)
        moved = grown.world_from_sonar[last] @ invert(before)
        grown.world_from_sonar[last + 1 :] = moved @ grown.world_from_sonar[last + 1 :]


def _adjust_frames(grown: IncrementalMap, first: int, last: int) -> None:
    """Adjust the frames first..last and the points that they see; earlier frames that see those stay fixed."""
    tracks = grown.tracks
    now = tracks.frame <= last
    in_window = np.bincount(tracks.track[now & (tracks.frame >= first)], minlength=tracks.count) > 0
    used = np.flatnonzero(now & in_window[tracks.track])
    problem, frames, points = number_problem(grown.template, tracks, grown.sigma, used)
    free = frames > max(first, int(frames[0]))
    found = adjust_narrowing(problem, grown.world_from_sonar[frames], grown.xyz_m[points], free)
    grown.world_from_sonar[frames], grown.xyz_m[points] = found.world_from_sonar, found.xyz_m
