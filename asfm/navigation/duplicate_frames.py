"""Frames that show the image of the frame before once more, while the vehicle moves: a recorder's hiccup."""

from collections.abc import Sequence as Rows
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.diagnostics import Diagnostic, format_runs, frame_runs
from asfm.geometry.poses import steps_between
from asfm.navigation.odometry import Odometry
from asfm.types import BoolArray, Keypoints, Matches

FEWEST_KEYPOINTS = 10
"""An image with fewer features may look like another by chance."""


def find_duplicate_frames(keypoints: Rows[Keypoints]) -> BoolArray:
    """Tell which frames show exactly the features of the frame before, to the last bit: (N,)."""
    same = [
        len(after) >= FEWEST_KEYPOINTS
        and np.array_equal(before.range_m, after.range_m)
        and np.array_equal(before.bearing_rad, after.bearing_rad)
        for before, after in pairwise(keypoints)
    ]
    return np.array([False, *same][: len(keypoints)], dtype=bool)


def drop_duplicate_frames(
    keypoints: Rows[Keypoints], candidates: list[Matches], odometry: Odometry | None
) -> tuple[list[Matches], tuple[Diagnostic, ...]]:
    """Leave out the matches of repeated frames where odometry has moved meanwhile: they would say that it stood still.

    A sonar that stands before a still scene may well repeat itself: where odometry does not move, nothing is left out.

    Returns:
        The matches that remain, and a diagnostic where some were left out.
    """
    duplicates = find_duplicate_frames(keypoints)
    if odometry is None or not duplicates.any():
        return candidates, ()
    steps, sigma = steps_between(odometry.world_from_vehicle), odometry.step_sigma
    turn_rad = np.linalg.norm(Rotation.from_matrix(steps[:, :3, :3]).as_rotvec(), axis=1)
    shift_m = np.linalg.norm(steps[:, :3, 3], axis=1)
    squares = (turn_rad / sigma[:, 0]) ** 2 + (shift_m / sigma[:, 1]) ** 2
    meanwhile = duplicates[1:]
    # noise alone makes six on average, as many as a step has degrees of freedom
    if squares.sum() < 6 * len(steps) + 3 * np.sqrt(12 * len(steps)) or squares[meanwhile].mean() < 6:
        return candidates, ()
    turn_rad, shift_m = turn_rad[meanwhile], shift_m[meanwhile]
    kept = [match for match in candidates if not (duplicates[match.frame_a] or duplicates[match.frame_b])]
    runs = frame_runs(duplicates)
    message = (
        f"{int(duplicates.sum())} of {len(duplicates)} frames ({format_runs(runs)}) repeat the image before them while "
        f"odometry moves by {float(np.median(shift_m)):.2g} m and {np.rad2deg(np.median(turn_rad)):.2g} deg a frame: "
        "their matches are left out"
    )
    return kept, (Diagnostic("duplicate-frames", message, runs),)
