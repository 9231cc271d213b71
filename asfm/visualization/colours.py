"""Colours of keypoints, matches, tracks and trajectories."""

import numpy as np
from numpy.typing import NDArray

from asfm.types import IntArray

Colour = tuple[int, int, int]

KEYPOINT: Colour = (255, 214, 64)
MATCH: Colour = (255, 64, 200)
MASK: Colour = (64, 255, 128)
REJECTED: dict[str, Colour] = {
    "ssl": (255, 96, 64),
    "planar": (255, 160, 32),
    "clique": (200, 140, 60),
    "arc": (80, 160, 255),
    "ratio": (120, 120, 130),
    "mutual": (80, 80, 90),
}
"""Matches that each filter rejected."""
TRAJECTORY: dict[str, Colour] = {
    "estimate": (64, 180, 255),
    "odometry": (255, 120, 80),
    "groundtruth": (70, 220, 110),
}
TRAJECTORY_NAMES = {"estimate": "estimate blue", "odometry": "odometry orange", "groundtruth": "ground truth green"}
ARC: Colour = (58, 58, 68)
ARC_IN_VIEW: Colour = (140, 140, 165)
FRUSTUM: Colour = (110, 130, 150)


def choose_hues(number: IntArray) -> NDArray[np.uint8]:
    """Return an RGB colour for each of (N,) numbers, (N, 3); hues of neighbours differ by the golden ratio."""
    phase = number[:, None] * 0.618034 + np.array([0.0, 1 / 3, 2 / 3])
    return np.asarray(127.5 + 127.5 * np.cos(2 * np.pi * phase)).astype(np.uint8)
