"""Partially mirrored solutions: detect the frame where the reflection flips, mirror the rest and optimise again.

A scene and its mirror image give the same sonar measurements (:mod:`asfm.backend.ambiguity.mirror_ambiguity`). Where
the motion of some frames hardly constrains elevations, an optimisation may continue with the other image from there
on. Both parts then fit well, and only tracks that span the flip fit slightly worse: a local optimum.
"""

import numpy as np
from threadpoolctl import threadpool_limits

from asfm.backend.ambiguity.mirror_search import search_other_optima
from asfm.backend.estimation.residual_gate import GUESSED_SLACK, ResidualGate, make_residual_gate
from asfm.backend.estimation.solution import Solution, correlated_variance, solve_tracks
from asfm.backend.estimation.triangulation import squared_residuals
from asfm.config import Config
from asfm.geometry.poses import invert
from asfm.sequence import Sequence
from asfm.types import FloatArray

MAX_FLIPS, MAX_CANDIDATES = 3, 2
"""Other solutions that are taken at most, one after the other, and candidates for each that are adjusted in full."""
MIN_GAIN = 5.0
"""Decrease of the cost in the search from which on a solution is a candidate."""
MIN_EVIDENCE = 25.0
"""Decrease of the cost in the search plus the logarithm of the odds in full from which on a candidate is accepted.
Features that slide along edges have errors in common over many tracks, which the noise model does not include; lower
thresholds accepted wrong solutions."""


def correct_partial_mirroring(solution: Solution, sequence: Sequence, config: Config) -> Solution:
    """Mirror the frames after a flip and optimise, as long as the solution becomes clearly better.

    With odometry, depth or attitude the mirror image is excluded in every frame: the solution is returned unchanged.

    Args:
        solution: converged.
        sequence: gives the sonar and its lever arm.
        config: as for :func:`solve_tracks`.
    """
    sensors = solution.problem.sensors
    if sensors.measured or len(sensors.z_roll_pitch) or not solution.observed.any():
        return solution
    for _ in range(MAX_FLIPS):
        better = _find_better(solution, sequence, config)
        if better is None:
            break
        solution = better
    return solution


def _find_better(solution: Solution, sequence: Sequence, config: Config) -> Solution | None:
    """Return the best of the most promising other solutions where it fits better, or None."""
    sensors, tracks = solution.problem.sensors, solution.tracks
    # Threads cost more than they save in matrices of this size.
    with threadpool_limits(1):
        promising = [found for found in search_other_optima(solution) if found.gain > MIN_GAIN][:MAX_CANDIDATES]
    if not promising:
        return None
    residual_gate = make_residual_gate(tracks, sequence, sensors, config)
    settled = solve_tracks(tracks, sequence, solution.bundle.world_from_vehicle, sensors, config)
    best, most = None, MIN_EVIDENCE
    for found in promising:
        poses = found.world_from_sonar @ invert(sequence.vehicle_from_sonar)
        other = solve_tracks(tracks, sequence, poses, sensors, config)
        log_odds = compare_fits(settled, other, sequence, residual_gate, config.backend.track_correlation)
        if log_odds > 0 and found.gain + log_odds > most:
            best, most = other, found.gain + log_odds
    return best


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
