"""A chain of planar motions between frames: where the poses start when there is no odometry."""

import numpy as np

from asfm.geometry.planar_motion import estimate_planar_motion_msac
from asfm.geometry.poses import invert
from asfm.types import BoolArray, FloatArray, IntArray, Tracks

MIN_SHARED = 4
"""Fewest shared tracks from which a planar motion is believed."""
MAX_GAP = 4
"""How many frames back a frame looks for one that it shares enough with."""


def estimate_planar_motion(
    xy_a: FloatArray, xy_b: FloatArray, tolerance_m: FloatArray, rng: np.random.Generator, trials: int = 300
) -> tuple[FloatArray, BoolArray]:
    """Find the planar motion a_from_b that most points agree with, by RANSAC over pairs of points.

    The points are those of elevation zero, (r cos(theta), r sin(theta)).

    Args:
        xy_a, xy_b: (M, 2) the same points seen from two frames, M >= 2.
        tolerance_m: (M,) how far an agreeing point may lie.

    Returns:
        (4, 4) a_from_b with no motion out of the plane, (M,) which points agree.
    """
    picks = np.array([rng.choice(len(xy_a), 2, replace=False) for _ in range(trials)])
    return estimate_planar_motion_msac(xy_a, xy_b, tolerance_m, picks)


def planar_odometry(
    tracks: Tracks, frame_count: int, first_pose: FloatArray, vehicle_from_sonar: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, BoolArray]:
    """Chain the planar motions between consecutive frames.

    Where a frame shares too little with those before it, the last pose is held, and the chain goes on from there.

    Returns:
        (N, 4, 4) world_from_vehicle, (N,) false where the pose was held for want of shared tracks.
    """
    world_from_sonar = np.repeat((first_pose @ vehicle_from_sonar)[None], frame_count, axis=0)
    supported = np.zeros(frame_count, dtype=bool)
    supported[0] = True
    xy = np.stack([tracks.range_m * np.cos(tracks.bearing_rad), tracks.range_m * np.sin(tracks.bearing_rad)], axis=1)
    of_frame = tracks.by_frame(frame_count)
    for frame in range(1, frame_count):
        world_from_sonar[frame] = world_from_sonar[frame - 1]
        before = range(frame - 1, max(frame - 1 - MAX_GAP, -1), -1)
        for other in sorted(before, key=lambda index: not supported[index]):  # a held pose is the last resort
            a, b = _shared(tracks, of_frame[other], of_frame[frame])
            if len(a) < MIN_SHARED:
                continue
            tolerance_m = 0.03 * tracks.range_m[b]
            motion, agrees = estimate_planar_motion(xy[a], xy[b], tolerance_m, rng)
            if agrees.sum() >= MIN_SHARED:
                world_from_sonar[frame] = world_from_sonar[other] @ motion
                supported[frame] = True
                break
    return world_from_sonar @ invert(vehicle_from_sonar), supported


def _shared(tracks: Tracks, a: IntArray, b: IntArray) -> tuple[IntArray, IntArray]:
    _, in_a, in_b = np.intersect1d(tracks.track[a], tracks.track[b], return_indices=True)
    return a[in_a], b[in_b]
