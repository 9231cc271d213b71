"""Number of false alarms (NFA) of a motion estimated from matches, by an a-contrario test."""

import numpy as np
from scipy.stats import binom

from asfm.types import BoolArray


def log_false_alarms(tried: int, agree: int, candidates: BoolArray) -> float:
    """Compute log10 of the number of false alarms: the expected number of equally supported motions by chance.

    The number of motions tested times the tail of a binomial distribution (Moisan and Stival 2004). Null hypothesis:
    the frames show different places, so that the match of a keypoint is a random keypoint of frame b. Two matches
    define a motion, and each other one is an inlier with the probability that a random keypoint of b is.

    Args:
        tried: number of matches among which the motion was searched.
        agree: number of inliers, those two included.
        candidates: (Ka, Kb) which keypoints of b lie where the motion predicts those of a; rows of unmatched keypoints
            are all false.

    Returns:
        log10 of the number; 0 with two inliers or fewer, or without candidates.
    """
    rows = candidates.any(axis=1)
    if agree <= 2 or not rows.any():
        return 0.0
    probability = float(np.clip(candidates[rows].mean(), 1e-6, 1.0))
    motions = 0.5 * tried * (tried - 1)
    return float(np.log10(max(motions, 1.0)) + binom.logsf(agree - 3, tried - 2, probability) / np.log(10))
