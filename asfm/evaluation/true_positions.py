"""True positions of one frame's keypoints in another frame, from a simulation's elevations."""

from dataclasses import dataclass

import numpy as np

from asfm.evaluation.arc_consistency import Tolerance
from asfm.geometry.poses import transform
from asfm.geometry.sonar import back_project, project
from asfm.types import BoolArray, FloatArray, Keypoints

TRUTH_TOLERANCE = Tolerance(0.10, float(np.radians(1.5)))
"""A match is correct when its second keypoint lies this close to the true position of the first one's point."""
MAX_ECHO_DISTANCE_PX = 2.0
"""A keypoint may lie beside its echo: the nearest pixel with an elevation this close counts."""


@dataclass(frozen=True)
class TruePositions:
    """True positions of the points of one frame's keypoints in another frame."""

    range_m: FloatArray
    """(K,), zero where unknown."""
    bearing_rad: FloatArray
    """(K,), zero where unknown."""
    known: BoolArray
    """(K,) false where nothing echoes near the keypoint: it is noise, and none of its matches is correct."""


def look_up_elevation(
    row_column: FloatArray, elevation_rad: FloatArray, max_distance_px: float = MAX_ECHO_DISTANCE_PX
) -> tuple[FloatArray, BoolArray]:
    """Return the elevation of the nearest pixel that has one.

    Args:
        row_column: (K, 2) fractional, pixel centres at +0.5.
        elevation_rad: (ranges, beams), NaN where nothing echoes.
        max_distance_px: largest distance to the centre of that pixel.

    Returns:
        (K,) elevation, zero where unknown, and (K,) whether it is known.
    """
    radius = int(np.ceil(max_distance_px))
    offset = np.indices((2 * radius + 1, 2 * radius + 1)).reshape(2, -1).T - radius
    pixel = np.floor(row_column).astype(int)[:, None] + offset
    distance_px = np.linalg.norm(pixel + 0.5 - row_column[:, None], axis=-1)
    inside = np.all((pixel >= 0) & (pixel < elevation_rad.shape), axis=-1)
    row, column = np.moveaxis(np.where(inside[..., None], pixel, 0), -1, 0)
    candidate_rad = elevation_rad[row, column].astype(float)
    distance_px[~inside | ~np.isfinite(candidate_rad) | (distance_px > max_distance_px)] = np.inf
    keypoint, nearest = np.arange(len(pixel)), np.argmin(distance_px, axis=1)
    known = np.isfinite(distance_px[keypoint, nearest])
    return np.where(known, candidate_rad[keypoint, nearest], 0.0), known


def find_true_positions(
    keypoints: Keypoints, elevation_rad: FloatArray, sonar_b_from_sonar_a: FloatArray
) -> TruePositions:
    """Project the keypoints of frame a, at their true elevation, into frame b.

    Args:
        keypoints: (K) of frame a.
        elevation_rad: (ranges, beams) true elevation of frame a, NaN where nothing echoes.
        sonar_b_from_sonar_a: (4, 4) true relative pose.
    """
    elevation, known = look_up_elevation(keypoints.row_column, elevation_rad)
    in_a_m = back_project(keypoints.range_m, keypoints.bearing_rad, elevation)
    range_m, bearing_rad, _ = project(transform(sonar_b_from_sonar_a, in_a_m))
    return TruePositions(np.where(known, range_m, 0.0), np.where(known, bearing_rad, 0.0), known)
