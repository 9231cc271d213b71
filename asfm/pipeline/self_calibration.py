"""Mounting and water: what the tracks tell of the lever arm's rotation and of a range bias, where it is asked for."""

from dataclasses import replace

import numpy as np

from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.self_calibration import Calibration, calibrate
from asfm.config import Config
from asfm.sequence import Sequence
from asfm.stages import StageClock
from asfm.types import Keypoints


def estimate_calibration(solution: Solution, config: Config, clock: StageClock) -> Calibration:
    """Estimate the lever arm's rotation and a range bias where the configuration asks for them."""
    wanted = config.backend.estimate_lever_rotation or config.backend.estimate_range_bias
    if not wanted or not solution.observed.any():
        return Calibration(np.zeros(3), 0.0, np.zeros(4))
    with clock.stage("calibration"):
        bundle = solution.bundle
        return calibrate(solution.problem, bundle.world_from_vehicle, bundle.xyz_m, config.backend)


def apply_calibration(
    calibration: Calibration, sequence: Sequence, keypoints: list[Keypoints]
) -> tuple[Sequence, list[Keypoints]]:
    """Correct the lever arm and every measured range."""
    bias_m = calibration.range_bias_m
    return (
        replace(sequence, vehicle_from_sonar=calibration.correct_mounting(sequence.vehicle_from_sonar)),
        [replace(frame, range_m=np.maximum(frame.range_m - bias_m, 1e-3)) for frame in keypoints],
    )
