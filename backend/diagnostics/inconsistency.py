"""Inconsistency of a solution with its measurements: residual statistics, calibration scores, and their diagnostics."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from asfm.backend.diagnostics.calibration_parameters import NUMBER, PARAMETERS
from asfm.backend.diagnostics.calibration_scores import CalibrationScores, score_calibration
from asfm.backend.diagnostics.linearised_residuals import linearise_residuals
from asfm.backend.diagnostics.residual_consistency import MAX_MEAN_SQUARE, measure_residuals
from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.schur_complement import PoseInformation
from asfm.consistency import CalibrationScore, Consistency, ResidualStatistics
from asfm.diagnostics import Diagnostic, FrameRuns
from asfm.types import FloatArray, Landmarks

MIN_SCORE_SIGMAS = 3.3
"""A calibration error is reported from this many of its standard deviations on."""
RIVAL_SHARE = 0.6
"""Other explanations are named beside the best one from this share of its standard deviations on."""
OF_READINGS = (NUMBER["depth_scale"], NUMBER["navigation_delay"])
"""Parameters that are examined without odometry: the motion prior, which prefers a small world, biases all others."""
MAX_EXPLANATIONS = 4
"""Explanations named at most."""
MIN_USED_SHARE, MIN_OBSERVATIONS = 0.3, 100
"""Where fewer observations than this share agree with the result, of at least so many, the images contradict it."""


def measure_consistency(
    solution: Solution, timestamps_s: FloatArray, information: PoseInformation, max_views: int
) -> Consistency:
    """Compare a solution with the stated noise and calibration of its measurements.

    The calibration is examined where other sensors measured the motion too: the sonar alone cannot contradict itself.

    Args:
        solution: poses and points at the optimum.
        timestamps_s: (N,) stamps of the frames.
        information: that of the poses and points at the same optimum.
        max_views: observations of a track that the adjustment uses at most.
    """
    blocks = linearise_residuals(solution, timestamps_s)
    residuals = measure_residuals(blocks, len(timestamps_s))
    if len(blocks) < 2 or not solution.observed.any():
        return Consistency(residuals)
    examined = range(len(PARAMETERS)) if solution.problem.sensors.measured else OF_READINGS
    scores = _list_scores(score_calibration(blocks, information), examined)
    return Consistency(residuals, scores, measure_used_share(solution, max_views))


def measure_used_share(solution: Solution, max_views: int) -> float:
    """Return the share of the observations that the adjustment used; 1 where there are too few to tell."""
    tracks = solution.tracks
    possible = int(np.minimum(np.bincount(tracks.track), max_views).sum())
    if possible < MIN_OBSERVATIONS:
        return 1.0
    return min(float(np.count_nonzero(solution.observed) / possible), 1.0)


def _list_scores(scores: CalibrationScores, examined: Iterable[int]) -> tuple[CalibrationScore, ...]:
    """List the error of every examined parameter that is observed, estimated alone."""
    found = []
    for index in sorted(set(examined) & set(scores.observed.tolist())):
        value, sigma = (float(array[0]) for array in scores.estimate([index]))
        parameter = PARAMETERS[index]
        inconsistent = abs(value) > max(MIN_SCORE_SIGMAS * sigma, parameter.tolerance)
        found.append(CalibrationScore(parameter.name, value, sigma, inconsistent))
    return tuple(found)


def warn_of_inconsistency(consistency: Consistency) -> tuple[Diagnostic, ...]:
    """Report the sensors whose residuals exceed their stated noise, and a calibration that does not fit."""
    bad = {item.sensor: item for item in consistency.residuals if item.inconsistent}
    found = []
    if odometry := [bad[name] for name in ("odometry rotation", "odometry translation") if name in bad]:
        message = f"odometry contradicts the result: {_describe(odometry)}; check its units, axes, stamps and noise"
        found.append(Diagnostic("odometry-inconsistent", message, _frames(odometry)))
    if "depth" in bad:
        message = f"depth contradicts the result: {_describe([bad['depth']])}; check its sign, unit, stamps and noise"
        found.append(Diagnostic("depth-inconsistent", message, bad["depth"].inconsistent))
    if "attitude" in bad:
        message = (
            f"attitude contradicts the result: {_describe([bad['attitude']])}; check its unit, signs, stamps and noise"
        )
        found.append(Diagnostic("attitude-inconsistent", message, bad["attitude"].inconsistent))
    if sonar := [bad[name] for name in ("sonar range", "sonar bearing") if name in bad]:
        message = (
            f"the images contradict the result: {_describe(sonar)}; check the order and the geometry of the images"
        )
        found.append(Diagnostic("images-inconsistent", message, _frames(sonar)))
    if consistency.used_share < MIN_USED_SHARE:
        message = (
            f"only {100 * consistency.used_share:.0f} % of what was tracked in the images agrees with the result; "
            f"{100 * MIN_USED_SHARE:.0f} % or more are expected: images and other sensors contradict each other"
        )
        found.append(Diagnostic("images-inconsistent", message))
    return (*found, *_warn_of_calibration(consistency.calibration))


def _describe(items: list[ResidualStatistics]) -> str:
    return ", ".join(
        f"{item.sensor} differs by {np.sqrt(item.worst_mean_square):.1f} times its stated noise in frames "
        f"{item.worst_frames[0]}-{item.worst_frames[1]} (chi-square {item.worst_mean_square:.1f} a degree of freedom "
        f"there, {item.mean_square:.1f} over all; up to {MAX_MEAN_SQUARE:g} is expected)"
        for item in items
    )


def _frames(items: list[ResidualStatistics]) -> FrameRuns:
    return tuple(sorted({run for item in items for run in item.inconsistent}))


def _warn_of_calibration(scores: tuple[CalibrationScore, ...]) -> tuple[Diagnostic, ...]:
    """Report a calibration error, with the explanations that fit about as well, best first."""
    if not any(score.inconsistent for score in scores):
        return ()
    ranked = sorted(scores, key=lambda score: -abs(score.value) / max(score.sigma, 1e-300))
    best = abs(ranked[0].value) / ranked[0].sigma
    named = [s for s in ranked if abs(s.value) / s.sigma >= RIVAL_SHARE * best and abs(s.value) > _tolerance(s)]
    explanations = ", or ".join(_explain(score) for score in named[:MAX_EXPLANATIONS])
    message = f"images and other sensors fit together only with another calibration: {explanations}"
    return (Diagnostic("calibration-inconsistent", message),)


def _tolerance(score: CalibrationScore) -> float:
    return PARAMETERS[NUMBER[score.parameter]].tolerance


def _explain(score: CalibrationScore) -> str:
    """Put one calibration error into words: what it means, its size and its standard deviation."""
    parameter = PARAMETERS[NUMBER[score.parameter]]
    meaning = parameter.positive if score.value > 0 else parameter.negative
    size, sigma = abs(score.value) / parameter.unit_size, score.sigma / parameter.unit_size
    return f"{meaning} by {size:.2g} +- {sigma:.1g} {parameter.unit}"


def withdraw_well_constrained(landmarks: Landmarks, consistency: Consistency, contradicted: bool = False) -> Landmarks:
    """Mark no landmark as well constrained where measurements contradict the poses: its sigma is not to be trusted.

    Args:
        landmarks: as the covariances say.
        consistency: of the residuals and the calibration.
        contradicted: whether another test found that the measurements contradict each other.
    """
    sensors = any(item.inconsistent for item in consistency.residuals)
    contradicted = contradicted or sensors or any(item.inconsistent for item in consistency.calibration)
    contradicted |= consistency.used_share < MIN_USED_SHARE
    return replace(landmarks, well_constrained=landmarks.well_constrained & (not contradicted))
