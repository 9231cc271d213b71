"""Pose accuracy: share of poses within a threshold of position and rotation, and the area under that curve (AUC)."""

import numpy as np

from asfm.evaluation.evaluation_table import EvaluationRow
from asfm.types import FloatArray

THRESHOLDS = (1, 2, 5, 10)
"""Largest errors: of the position in percent of the path's length, and of the rotation in degrees."""
ALIGNMENT = "SE(3)- and rotation-aligned, scale off"
"""Positions are aligned in SE(3), rotations by themselves: a nearly straight path hardly determines them."""


def share_within(error: FloatArray, threshold: float) -> float:
    """Return the share of (N,) errors, N >= 1, up to a threshold inclusive."""
    return float(np.mean(error <= threshold))


def area_under_curve(error: FloatArray, threshold: float) -> float:
    """Return the area under the curve of the shares of (N,) errors up to a threshold, N >= 1, divided by the threshold.

    It is the exact area under the empirical distribution, a curve of steps: each error contributes
    1 - error / threshold, or nothing beyond it. The pose AUC of Sarlin et al. (SuperGlue, 2020) joins the steps by
    straight lines, from (0, 0) on, and is larger by 1 / N at most.
    """
    return float(np.mean(np.maximum(0.0, 1.0 - error / threshold)))


def list_accuracy(translation_m: FloatArray, rotation_rad: FloatArray, path_m: float) -> list[EvaluationRow]:
    """Return the shares of poses within :data:`THRESHOLDS`, and the areas under the curve up to each of them, as rows.

    A pose is within a threshold where its position is, in percent of the path, and its rotation, in degrees. Without a
    path there are rows of the rotation alone.

    Args:
        translation_m: (N,) errors of the positions.
        rotation_rad: (N,) errors of the rotations.
        path_m: length of the reference path.
    """
    rotation_deg = np.degrees(rotation_rad)
    of_rotations = _list_shares("rotation", "deg", "deg", rotation_deg)
    if path_m <= 0:
        return of_rotations
    percent = 100 * translation_m / path_m
    worse = np.maximum(percent, rotation_deg)
    named = [(at, f"{at}_percent_{at}_deg", f"{at} % of the path and {at} deg, {ALIGNMENT}") for at in THRESHOLDS]
    shares = (
        EvaluationRow(f"poses_within_{key}", f"share of poses within {name}", share_within(worse, at), "")
        for at, key, name in named
    )
    areas = (
        EvaluationRow(f"pose_auc_{key}", f"pose AUC up to {name}", area_under_curve(worse, at), "")
        for at, key, name in named
    )
    return [*shares, *areas, *_list_shares("position", "percent", "% of the path", percent), *of_rotations]


def _list_shares(what: str, unit_key: str, unit: str, error: FloatArray) -> list[EvaluationRow]:
    """Return the shares of (N,) errors of the position or the rotation alone, which are not printed."""
    return [
        EvaluationRow(
            f"poses_{what}_within_{at}_{unit_key}",
            f"share of poses with a {what} error within {at} {unit}, {ALIGNMENT}",
            share_within(error, at),
            "",
            detail=True,
        )
        for at in THRESHOLDS
    ]
