"""Number of false alarms (a contrario) of a motion that several matches agree on."""

import numpy as np
from scipy.stats import binom

from asfm.types import BoolArray


def log_false_alarms(tried: int, agree: int, candidates: BoolArray) -> float:
    """Return log10 of the expected number of motions that as many matches agree on by chance.

    The number of motions tried times the tail of a binomial distribution (Moisan and Stival 2004). In frames of two
    different places the nearest descriptor may lie anywhere. Of the matches tried, two define a motion; each other
    match then agrees with it with the probability that a random keypoint of frame b does.

    Args:
        tried: number of matches among which the motion was sought.
        agree: number of matches that agree with it.
        candidates: (Ka, Kb) which keypoints of b lie where the motion predicts those of a; rows of unmatched keypoints
            are all false.
    """
    rows = candidates.any(axis=1)
    if agree <= 2 or not rows.any():
        return 0.0
    chance = float(np.clip(candidates[rows].mean(), 1e-6, 1.0))
    motions = 0.5 * tried * (tried - 1)
    return float(np.log10(max(motions, 1.0)) + binom.logsf(agree - 3, tried - 2, chance) / np.log(10))
