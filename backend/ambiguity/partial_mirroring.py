"""Partially mirrored solutions: detect the frame where the reflection flips, mirror the rest and optimise again.

A scene and its mirror image give the same sonar measurements (:mod:`asfm.backend.ambiguity.mirror_ambiguity`). Where
the motion of some frames hardly constrains elevations, an optimisation may continue with the other image from there
on. Both parts then fit well, and only tracks that span the flip fit slightly worse: a local optimum.
"""

import numpy as np

from asfm.backend.ambiguity.reflection import reflect_after
from asfm.backend.estimation.residual_gate import GUESSED_SLACK, ResidualGate, make_residual_gate
from asfm.backend.estimation.solution import Solution, correlated_variance, solve_tracks
from asfm.backend.estimation.triangulation import squared_residuals, triangulate_tracks
from asfm.config import Config
from asfm.geometry.poses import invert
from asfm.sequence import Sequence
from asfm.types import FloatArray, IntArray, Tracks

FRAME_STRIDE = 4
"""Every so many frames one is tested: a flip extends over several."""
MAX_TRACKS = 30
"""Tracks by which a frame is tested: those that extend farthest to both sides."""
ELEVATION_COUNT = 9
"""Elevations tried in triangulation, fewer than by default: residuals are only compared."""
MIN_DEPTH = 0.05
"""Depth of a local minimum of the relative residual below its surroundings to be significant."""
MIN_LOG_ODDS = 9.2
"""Logarithm of the odds at which another solution is accepted: 10,000 to 1. Features that slide along edges have errors
in common over many tracks, which the noise model does not include; lower thresholds accepted wrong solutions."""
MIN_FRAMES_TO_END = 2
"""Frames before the first and after the last one that is tested."""


def correct_partial_mirroring(solution: Solution, sequence: Sequence, config: Config) -> Solution:
    """Mirror the frames after the most likely flip, optimise, and return the better solution.

    With odometry, depth or attitude the mirror image is excluded in every frame: the solution is returned unchanged.

    Args:
        solution: converged.
        sequence: gives the sonar and its lever arm.
        config: as for :func:`solve_tracks`.
    """
    sensors = solution.problem.sensors
    if sensors.measured or len(sensors.z_roll_pitch) or not solution.observed.any():
        return solution
    tracks, poses = solution.tracks, solution.bundle.world_from_vehicle
    residual_gate = make_residual_gate(tracks, sequence, sensors, config)
    frames, increase = scan_mirror_frames(tracks, poses, sequence, residual_gate)
    flip = find_local_minimum(frames, increase)
    if flip is None:
        return solution
    mirrored = reflect_after(poses, flip, sequence.vehicle_from_sonar)
    other = solve_tracks(tracks, sequence, mirrored, sensors, config)
    log_odds = compare_fits(solution, other, sequence, residual_gate, config.backend.track_correlation)
    return other if log_odds > MIN_LOG_ODDS else solution


def scan_mirror_frames(
    tracks: Tracks, world_from_vehicle: FloatArray, sequence: Sequence, residual_gate: ResidualGate
) -> tuple[IntArray, FloatArray]:
    """Compute the relative increase of residuals when the poses after a frame are mirrored, for a grid of frames.

    Args:
        tracks: O observations.
        world_from_vehicle: (N, 4, 4) poses.
        sequence: gives the sonar and its lever arm.
        residual_gate: sigmas and truncation of the residuals.

    Returns:
        (F,) tested frames, and (F,) increase of the squared residuals of the tracks that span each, relative to those
        without mirroring.
    """
    first, last = tracks.frame_span()
    frames, increase = [], []
    for frame in range(MIN_FRAMES_TO_END, len(world_from_vehicle) - MIN_FRAMES_TO_END - 1, FRAME_STRIDE):
        spanning = np.flatnonzero((first <= frame) & (last > frame))
        reach = np.minimum(frame + 1 - first[spanning], last[spanning] - frame)
        chosen = spanning[np.argsort(-reach, kind="stable")[:MAX_TRACKS]]
        if not len(chosen):
            continue
        mirrored = reflect_after(world_from_vehicle, frame, sequence.vehicle_from_sonar)
        before, after = (
            _triangulation_cost(tracks, chosen, poses, sequence, residual_gate)
            for poses in (world_from_vehicle, mirrored)
        )
        frames.append(frame)
        increase.append((after - before) / max(before, 1e-9))
    return np.array(frames, dtype=np.int64), np.array(increase)


def find_local_minimum(frames: IntArray, increase: FloatArray) -> int | None:
    """Return the frame of the lowest significant local minimum, or None.

    Towards both ends of a sequence the increase of the residuals falls because fewer tracks span the frame: a minimum
    counts only with higher values on both sides.

    Args:
        frames: (F,) tested frames.
        increase: (F,) relative increase of the residuals.
    """
    minima = [
        (float(increase[index]), int(frames[index]))
        for index in range(1, len(frames) - 1)
        if increase[index] <= min(increase[index - 1], increase[index + 1])
        and min(increase[:index].max(), increase[index + 1 :].max()) - increase[index] >= MIN_DEPTH
    ]
    return min(minima)[1] if minima else None


def compare_fits(
    first: Solution, second: Solution, sequence: Sequence, residual_gate: ResidualGate, correlation: float
) -> float:
    """Compute the logarithm of the odds of a second solution against a first one.

    It is half the difference of their truncated squared residuals. Those of a track with n observations have the
    weight 1 / (1 + (n - 1) rho), as in the graph; the widening of the sigmas for triangulation is undone. Only tracks
    that have a point in both solutions count: a track that one of them has dropped may be a wrong one.

    Args:
        first: solution of the same tracks as the second.
        second: the other solution.
        sequence: gives the lever arm.
        residual_gate: sigmas and truncation of the residuals.
        correlation: rho, of the errors along a track.
    """
    tracks = first.tracks
    both = (first.bundle.in_graph & second.bundle.in_graph)[tracks.track]
    weight = both / correlated_variance(np.bincount(tracks.track)[tracks.track], correlation)
    before, after = (_square_residuals(solution, sequence, residual_gate) @ weight for solution in (first, second))
    return GUESSED_SLACK**2 * float(before - after) / 2


def _square_residuals(solution: Solution, sequence: Sequence, residual_gate: ResidualGate) -> FloatArray:
    """Compute truncated squared residuals, with the violation of the elevation aperture included: (O,)."""
    tracks, bundle, gate = solution.tracks, solution.bundle, residual_gate.gate
    sonar_from_world = invert(bundle.world_from_vehicle @ sequence.vehicle_from_sonar)[tracks.frame]
    square, _ = squared_residuals(bundle.xyz_m, tracks, sonar_from_world, residual_gate.sigma, gate)
    return np.minimum(square, gate.truncation**2)


def _triangulation_cost(
    tracks: Tracks, chosen: IntArray, world_from_vehicle: FloatArray, sequence: Sequence, residual_gate: ResidualGate
) -> float:
    """Triangulate the chosen tracks and sum their truncated squared residuals."""
    used = np.isin(tracks.track, chosen)
    found = triangulate_tracks(
        tracks.select(used),
        world_from_vehicle @ sequence.vehicle_from_sonar,
        sequence.sonar,
        residual_gate.sigma[used],
        residual_gate.gate,
        ELEVATION_COUNT,
    )
    return float(np.minimum((found.residual**2).sum(axis=1), residual_gate.gate.truncation**2).sum())
