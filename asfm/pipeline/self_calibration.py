"""Self-calibration stage: lever-arm rotation and constant range bias, where the configuration requests them."""

from dataclasses import replace

import numpy as np

from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.self_calibration import Calibration, calibrate
from asfm.config import Config
from asfm.sequence import Sequence
from asfm.stages import StageClock
from asfm.types import Keypoints

MIN_RANGE_M = 1e-3


def estimate_calibration(solution: Solution, config: Config, clock: StageClock) -> Calibration:
    """Estimate the lever arm's rotation and a range bias where the configuration requests them.

    Args:
        solution: poses, points and the problem that they solve.
        config: section ``backend``.
        clock: times the stage.

    Returns:
        A calibration of zeros with zero sigmas where nothing is requested or observed.
    """
    requested = config.backend.estimate_lever_rotation or config.backend.estimate_range_bias
    if not requested or not solution.observed.any():
        return Calibration(np.zeros(3), 0.0, np.zeros(4))
    with clock.stage("calibration"):
        bundle = solution.bundle
        return calibrate(solution.problem, bundle.world_from_vehicle, bundle.xyz_m, config.backend)


def apply_calibration(
    calibration: Calibration, sequence: Sequence, keypoints: list[Keypoints]
) -> tuple[Sequence, list[Keypoints]]:
    """Correct the lever arm of a sequence and the ranges of its keypoints.

    Args:
        calibration: rotation of the lever arm, and the range bias in metres.
        sequence: gives the lever arm.
        keypoints: those of every frame.

    Returns:
        The corrected sequence and keypoints; ranges stay positive.
    """
    bias_m = calibration.range_bias_m
    return (
        replace(sequence, vehicle_from_sonar=calibration.correct_mounting(sequence.vehicle_from_sonar)),
        [replace(frame, range_m=np.maximum(frame.range_m - bias_m, MIN_RANGE_M)) for frame in keypoints],
    )
