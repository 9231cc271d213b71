"""Twisted solutions: mirrored from some frame on, and how they are found and set right.

A scene and its mirror image look the same to the sonar (see :mod:`asfm.backend.ambiguity.mirror_ambiguity`). Where for
some frames the motion hardly tells elevations, an optimisation that has begun with one image can go on with the
other. The two parts then fit as well as ever, and only what spans the flip fits a little worse: a local optimum that
no small step leaves.
"""

import numpy as np

from asfm.backend.ambiguity.mirror_ambiguity import reflect_after
from asfm.backend.estimation.residual_gate import GUESSED_SLACK, ResidualGate, make_residual_gate
from asfm.backend.estimation.solution import Solution, correlated_variance, solve_tracks
from asfm.backend.estimation.triangulation import squared_residuals, triangulate_tracks
from asfm.config import Config
from asfm.geometry.poses import invert
from asfm.sequence import Sequence
from asfm.types import FloatArray, IntArray, Tracks

STRIDE = 4
"""Frames between two that are tried: a flip takes place over several."""
MOST_TRACKS = 30
"""Tracks that a frame is judged by: those that reach farthest to both sides."""
ELEVATIONS = 9
"""Fewer than triangulation tries by default: misfits are only compared."""
MIN_DEPTH = 0.05
"""How far the relative misfit must fall below what lies to both sides to count as a dip, not as chance."""
LEAST_ODDS = 9.2
"""Logarithm of the odds from which on another solution is taken: 10,000 to 1. Features that slide err alike in many
tracks, which no noise model here knows of; lesser odds have been seen to mislead."""
NEAREST_END = 2
"""Frames before the first and after the last one that is tried."""


def correct_partial_mirroring(solution: Solution, sequence: Sequence, config: Config) -> Solution:
    """Mirror the frames after the likeliest flip, adjust, and keep what fits better.

    Odometry, depth or attitude tell the images of every frame apart: with them, solutions are left as they are.
    """
    sensors = solution.problem.sensors
    if sensors.measured or len(sensors.z_roll_pitch) or not solution.observed.any():
        return solution
    tracks, poses = solution.tracks, solution.bundle.world_from_vehicle
    residual_gate = make_residual_gate(tracks, sequence, sensors, config)
    frames, misfit = scan_mirror_frames(tracks, poses, sequence, residual_gate)
    flip = find_local_minimum(frames, misfit)
    if flip is None:
        return solution
    turned = reflect_after(poses, flip, sequence.vehicle_from_sonar)
    other = solve_tracks(tracks, sequence, turned, sensors, config)
    odds = compare_fits(solution, other, sequence, residual_gate, config.backend.track_correlation)
    return other if odds > LEAST_ODDS else solution


def scan_mirror_frames(
    tracks: Tracks, world_from_vehicle: FloatArray, sequence: Sequence, residual_gate: ResidualGate
) -> tuple[IntArray, FloatArray]:
    """Measure by how much worse tracks fit when the poses after a frame are mirrored.

    Returns:
        (F,) the frames that were tried, (F,) the added misfit over that of the same tracks without.
    """
    first, last = _frame_span(tracks)
    frames, misfit = [], []
    for frame in range(NEAREST_END, len(world_from_vehicle) - NEAREST_END - 1, STRIDE):
        spanning = np.flatnonzero((first <= frame) & (last > frame))
        reach = np.minimum(frame + 1 - first[spanning], last[spanning] - frame)
        chosen = spanning[np.argsort(-reach, kind="stable")[:MOST_TRACKS]]
        if not len(chosen):
            continue
        turned = reflect_after(world_from_vehicle, frame, sequence.vehicle_from_sonar)
        before, after = (
            _fit_points(tracks, chosen, poses, sequence, residual_gate) for poses in (world_from_vehicle, turned)
        )
        frames.append(frame)
        misfit.append((after - before) / max(before, 1e-9))
    return np.array(frames, dtype=np.int64), np.array(misfit)


def find_local_minimum(frames: IntArray, misfit: FloatArray) -> int | None:
    """Choose the frame of the lowest dip, if there is one.

    Towards both ends of a sequence the misfit falls by itself, as ever fewer tracks span the frame: a dip has higher
    values to both sides.
    """
    dips = [
        (float(misfit[index]), int(frames[index]))
        for index in range(1, len(frames) - 1)
        if misfit[index] <= min(misfit[index - 1], misfit[index + 1])
        and min(misfit[:index].max(), misfit[index + 1 :].max()) - misfit[index] >= MIN_DEPTH
    ]
    return min(dips)[1] if dips else None


def compare_fits(
    first: Solution, second: Solution, sequence: Sequence, residual_gate: ResidualGate, correlation: float
) -> float:
    """Give the logarithm of the odds of a second solution to a first one.

    Half the difference of their squared residuals, truncated; those of a track with n observations count as
    1 / (1 + (n - 1) rho), as in the graph, and without the slack that triangulation gives their sigmas. Only tracks
    that both have points of: what one of them has dropped is as likely a wrong track as a telling one.
    """
    tracks = first.tracks
    both = (first.bundle.in_graph & second.bundle.in_graph)[tracks.track]
    weight = both / correlated_variance(np.bincount(tracks.track)[tracks.track], correlation)
    before, after = (_square_residuals(solution, sequence, residual_gate) @ weight for solution in (first, second))
    return GUESSED_SLACK**2 * float(before - after) / 2


def _square_residuals(solution: Solution, sequence: Sequence, residual_gate: ResidualGate) -> FloatArray:
    """Squared residual of every observation, how far it lies outside the beam included, truncated: (O,)."""
    tracks, bundle, gate = solution.tracks, solution.bundle, residual_gate.gate
    sonar_from_world = invert(bundle.world_from_vehicle @ sequence.vehicle_from_sonar)[tracks.frame]
    square, _ = squared_residuals(bundle.xyz_m, tracks, sonar_from_world, residual_gate.sigma, gate)
    return np.minimum(square, gate.truncation**2)


def _fit_points(
    tracks: Tracks, chosen: IntArray, world_from_vehicle: FloatArray, sequence: Sequence, residual_gate: ResidualGate
) -> float:
    """Triangulate some tracks and sum their truncated squared residuals."""
    used = np.isin(tracks.track, chosen)
    found = triangulate_tracks(
        tracks.select(used),
        world_from_vehicle @ sequence.vehicle_from_sonar,
        sequence.sonar,
        residual_gate.sigma[used],
        residual_gate.gate,
        ELEVATIONS,
    )
    return float(np.minimum((found.residual**2).sum(axis=1), residual_gate.gate.truncation**2).sum())


def _frame_span(tracks: Tracks) -> tuple[IntArray, IntArray]:
    """First and last frame of each track, (T,) each; observations are sorted by track and frame."""
    begins = np.flatnonzero(np.diff(tracks.track, prepend=-1))
    ends = np.append(begins[1:], len(tracks)) - 1
    return tracks.frame[begins], tracks.frame[ends]
