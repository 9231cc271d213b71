"""Duplicate frames: images that a recorder repeated while the vehicle moved."""

from collections.abc import Sequence as Rows
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.diagnostics import Diagnostic, format_runs, frame_runs
from asfm.geometry.poses import steps_between
from asfm.navigation.odometry import Odometry
from asfm.types import BoolArray, FloatArray, Keypoints, Matches

MIN_KEYPOINTS = 10
"""With fewer keypoints two images may agree by chance."""
STEP_DEGREES_OF_FREEDOM = 6


def find_duplicate_frames(keypoints: Rows[Keypoints]) -> BoolArray:
    """Return which (N,) frames have exactly the keypoints of the frame before, bit by bit."""
    same = [
        len(after) >= MIN_KEYPOINTS
        and np.array_equal(before.range_m, after.range_m)
        and np.array_equal(before.bearing_rad, after.bearing_rad)
        for before, after in pairwise(keypoints)
    ]
    return np.array([False, *same][: len(keypoints)], dtype=bool)


def drop_duplicate_frames(
    keypoints: Rows[Keypoints], candidates: list[Matches], odometry: Odometry | None
) -> tuple[list[Matches], tuple[Diagnostic, ...]]:
    """Drop the matches of duplicate frames during which odometry moved: they would imply a standstill.

    A stationary sonar in a static scene may rightly repeat its image: where odometry does not move, all matches stay.

    Args:
        keypoints: those of the N frames.
        candidates: matches of pairs of frames.
        odometry: steps between the frames; None keeps all matches, as for a sonar at rest.

    Returns:
        The remaining matches, and a diagnostic where some were dropped, or where nothing tells whether they should be.
    """
    duplicates = find_duplicate_frames(keypoints)
    if not duplicates.any():
        return candidates, ()
    if odometry is None:
        return candidates, (_diagnose_without_odometry(duplicates),)
    steps = steps_between(odometry.world_from_vehicle)
    turn_rad = np.linalg.norm(Rotation.from_matrix(steps[:, :3, :3]).as_rotvec(), axis=1)
    shift_m = np.linalg.norm(steps[:, :3, 3], axis=1)
    repeated = duplicates[1:]
    if not _has_moved(turn_rad, shift_m, odometry.step_sigma, repeated):
        return candidates, ()
    turn_rad, shift_m = turn_rad[repeated], shift_m[repeated]
    kept = [match for match in candidates if not (duplicates[match.frame_a] or duplicates[match.frame_b])]
    runs = frame_runs(duplicates)
    message = (
        f"{int(duplicates.sum())} of {len(duplicates)} frames ({format_runs(runs)}) repeat the image before them while "
        f"odometry moves by {float(np.median(shift_m)):.2g} m and {np.rad2deg(np.median(turn_rad)):.2g} deg a frame: "
        "their matches are left out"
    )
    return kept, (Diagnostic("duplicate-frames", message, runs),)


def _diagnose_without_odometry(duplicates: BoolArray) -> Diagnostic:
    """Report the (N,) duplicates of a recording that does not say whether the sonar moved."""
    runs = frame_runs(duplicates)
    message = (
        f"{int(duplicates.sum())} of {len(duplicates)} frames ({format_runs(runs)}) repeat the image before them bit "
        "by bit, which the noise of a sonar does not: they are taken for a sonar at rest, as no odometry "
        "says otherwise; check whether the recorder repeated them"
    )
    return Diagnostic("duplicate-frames", message, runs)


def _has_moved(turn_rad: FloatArray, shift_m: FloatArray, step_sigma: FloatArray, repeated: BoolArray) -> bool:
    """Test whether odometry moved by more than its noise, over all (N - 1,) steps and over the repeated ones.

    The squared norm of a step that is noise alone is chi-square distributed with six degrees of freedom: the mean is
    6, the variance 12.
    """
    squares = (turn_rad / step_sigma[:, 0]) ** 2 + (shift_m / step_sigma[:, 1]) ** 2
    freedom = STEP_DEGREES_OF_FREEDOM
    limit = freedom * len(squares) + 3 * np.sqrt(2 * freedom * len(squares))
    return not (squares.sum() < limit or squares[repeated].mean() < freedom)
