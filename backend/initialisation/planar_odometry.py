"""Planar odometry: a chain of planar motions between frames that share tracks."""

import numpy as np

from asfm.geometry.planar_motion import estimate_planar_motion_msac
from asfm.geometry.poses import invert
from asfm.types import BoolArray, FloatArray, IntArray, Tracks

MIN_SHARED = 4
"""Fewest shared tracks, and fewest inliers, of a planar motion."""
MAX_GAP = 4
"""Frames back within which a frame is connected to another."""
TOLERANCE_PER_RANGE = 0.03
"""Distance of an inlier from the planar motion, over its range."""


def estimate_planar_motion(
    xy_a: FloatArray, xy_b: FloatArray, tolerance_m: FloatArray, rng: np.random.Generator, trials: int = 300
) -> tuple[FloatArray, BoolArray]:
    """Estimate the planar motion a_from_b by RANSAC (MSAC) over pairs of points.

    The points are those of elevation zero, (r cos(theta), r sin(theta)).

    Args:
        xy_a: (M, 2) points in metres seen from frame a, M >= 2.
        xy_b: (M, 2) the same points seen from frame b.
        tolerance_m: (M,) largest distance of an inlier.
        rng: draws the samples.
        trials: number of samples.

    Returns:
        (4, 4) a_from_b without motion out of the plane, (M,) which points are inliers.
    """
    picks = np.array([rng.choice(len(xy_a), 2, replace=False) for _ in range(trials)])
    return estimate_planar_motion_msac(xy_a, xy_b, tolerance_m, picks)


def planar_odometry(
    tracks: Tracks, frame_count: int, first_pose: FloatArray, vehicle_from_sonar: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, BoolArray]:
    """Chain planar motions between near frames.

    A frame that shares too few tracks with those before it keeps the previous pose, and the chain continues from there.

    Args:
        tracks: observations of landmarks.
        frame_count: N.
        first_pose: (4, 4) world_from_vehicle of the first frame.
        vehicle_from_sonar: (4, 4) lever arm.
        rng: draws the RANSAC samples.

    Returns:
        (N, 4, 4) world_from_vehicle, (N,) whether a planar motion supports the pose; true for the first frame.
    """
    world_from_sonar = np.repeat((first_pose @ vehicle_from_sonar)[None], frame_count, axis=0)
    supported = np.zeros(frame_count, dtype=bool)
    supported[0] = True
    xy = np.stack([tracks.range_m * np.cos(tracks.bearing_rad), tracks.range_m * np.sin(tracks.bearing_rad)], axis=1)
    of_frame = tracks.by_frame(frame_count)
    for frame in range(1, frame_count):
        world_from_sonar[frame] = world_from_sonar[frame - 1]
        before = range(frame - 1, max(frame - 1 - MAX_GAP, -1), -1)
        for other in sorted(before, key=lambda index: not supported[index]):  # nearest first, unsupported poses last
            a, b = _shared(tracks, of_frame[other], of_frame[frame])
            if len(a) < MIN_SHARED:
                continue
            tolerance_m = TOLERANCE_PER_RANGE * tracks.range_m[b]
            motion, inlier = estimate_planar_motion(xy[a], xy[b], tolerance_m, rng)
            if inlier.sum() >= MIN_SHARED:
                world_from_sonar[frame] = world_from_sonar[other] @ motion
                supported[frame] = True
                break
    return world_from_sonar @ invert(vehicle_from_sonar), supported


def _shared(tracks: Tracks, a: IntArray, b: IntArray) -> tuple[IntArray, IntArray]:
    """Return the observations among two frames' (A,) and (B,) that belong to tracks of both, (M,) each."""
    _, in_a, in_b = np.intersect1d(tracks.track[a], tracks.track[b], return_indices=True)
    return a[in_a], b[in_b]
