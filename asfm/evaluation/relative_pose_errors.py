"""Relative pose errors (RPE) as rows: over one frame, and over several fractions of the path."""

import numpy as np

from asfm.evaluation.association import PosePairs
from asfm.evaluation.evaluation_table import EvaluationRow
from asfm.evaluation.trajectory import pairs_by_distance, pairs_by_step, path_length_m, relative_errors, summarise
from asfm.types import IntArray

SEGMENT_PERCENT = 10
"""Percent of the path over which the longer relative errors that are printed are taken."""
LENGTHS_PERCENT = (5, 20, 50)
"""Further percents of the path, in evaluation.json alone."""


def list_relative_errors(pairs: PosePairs) -> list[EvaluationRow]:
    """Measure the relative pose errors over one frame and over 10, 5, 20 and 50 percent of the path.

    Over a length, every pose is paired with the first one at least that far along the path. A length over which there
    is no such pair has no rows.
    """
    rows = _list_errors("frame", "one frame", pairs, *pairs_by_step(len(pairs)))
    path_m = path_length_m(pairs.reference)
    for percent in (SEGMENT_PERCENT, *LENGTHS_PERCENT):
        printed = percent == SEGMENT_PERCENT
        suffix, length = "segment" if printed else f"{percent}_percent_of_path", f"{percent} % of the path"
        ends = pairs_by_distance(pairs.reference, percent / 100 * path_m)
        rows += _list_errors(suffix, length, pairs, *ends, detail=not printed)
    return rows


def _list_errors(
    suffix: str, length: str, pairs: PosePairs, first: IntArray, last: IntArray, detail: bool = False
) -> list[EvaluationRow]:
    if not len(first):
        return []
    translation_m, rotation_rad = relative_errors(pairs.estimate, pairs.reference, first, last)
    translation = f"rpe_translation_rmse_m_{suffix}", f"RPE translation RMSE over {length}, scale off"
    rotation = f"rpe_rotation_rmse_deg_{suffix}", f"RPE rotation RMSE over {length}, scale off"
    rotation_deg = float(np.degrees(summarise(rotation_rad).rmse))
    return [
        EvaluationRow(*translation, summarise(translation_m).rmse, "m", detail=detail),
        EvaluationRow(*rotation, rotation_deg, "deg", detail=detail),
    ]
