"""Viewpoint of the 3-D view: an eye behind and above the path that has path and landmarks in view."""

from dataclasses import dataclass

import numpy as np

from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray

VIEW_TANGENTS = (0.85, 0.46)
"""Half the width and height in view at unit distance: 55 degrees with a margin, twice as wide as high."""
POINTS_IN_VIEW = 0.95
"""Share of the landmarks that must be in view; the others may be outliers."""


@dataclass(frozen=True)
class Viewpoint:
    """Eye and target of the 3-D view, in the world frame."""

    eye_m: FloatArray
    """(3,)"""
    target_m: FloatArray
    """(3,)"""
    floor_m: float
    """Height (z) of the ground grid, below path and landmarks."""


def choose_viewpoint(sonar: SonarModel, world_from_sonar: FloatArray, landmarks_m: FloatArray) -> Viewpoint:
    """Choose the nearest eye behind, above and beside the path that has path and landmarks in view.

    Args:
        sonar: its range stands in for landmarks where there are none.
        world_from_sonar: (N, 4, 4) path of the sonar.
        landmarks_m: (L, 3) in the world frame; a few outliers may be out of view.
    """
    path_m = world_from_sonar[:, :3, 3]
    if not len(landmarks_m):
        landmarks_m = path_m + sonar.range_m[-1] * world_from_sonar[:, :3, 0]
    box_m = np.concatenate([path_m, np.percentile(landmarks_m, [2, 98], axis=0)])
    low_m, high_m = box_m.min(axis=0), box_m.max(axis=0)
    target_m = (low_m + high_m) / 2
    ahead = world_from_sonar[:, :2, 0].mean(axis=0)
    ahead = ahead / np.hypot(*ahead) if np.hypot(*ahead) > 1e-6 else np.array([1.0, 0.0])  # the sonar looks down
    backward = np.array([-ahead[0] - 0.6 * ahead[1], -ahead[1] + 0.6 * ahead[0], 0.9])
    backward /= np.linalg.norm(backward)
    needed_m = [_find_distance_to_see(points_m - target_m, backward) for points_m in (path_m, landmarks_m)]
    distance_m = max(float(needed_m[0].max()), float(np.quantile(needed_m[1], POINTS_IN_VIEW)))
    return Viewpoint(target_m + distance_m * backward, target_m, float(low_m[2]))


def _find_distance_to_see(offset_m: FloatArray, backward: FloatArray) -> FloatArray:
    """Return (N,) distances (m) of the eye from its target at which points at (N, 3) offsets from it are in view."""
    right = np.array([-backward[1], backward[0], 0.0])
    right /= np.linalg.norm(right)
    up = np.cross(backward, right)
    sides = np.stack([np.abs(offset_m @ right) / VIEW_TANGENTS[0], np.abs(offset_m @ up) / VIEW_TANGENTS[1]])
    return np.asarray(offset_m @ backward + sides.max(axis=0))
