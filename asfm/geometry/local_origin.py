"""Local origin near a path: keeps coordinates small in worlds such as UTM, where rounding would otherwise be visible.

In single precision, as a viewer stores positions, a northing of 5.6e6 m has steps of 0.5 m.
"""

from dataclasses import replace

import numpy as np

from asfm.types import FloatArray, Landmarks, Reconstruction, Trajectory

GRID_M = 1000.0
"""Local origins are multiples of this: they read well, subtract exactly, and are zero for paths near the world's."""


def local_origin(xyz_m: FloatArray) -> FloatArray:
    """Return the local origin (C,) in the world, the grid point next to the median of (N, C) positions; 0 without any.

    The median keeps a path's origin where a few readings have none, such as zeros until a receiver has its first fix.
    """
    if not len(xyz_m):
        return np.zeros(xyz_m.shape[1])
    return np.asarray(GRID_M * np.round(np.median(xyz_m, axis=0) / GRID_M) + 0.0)


def shift_poses(pose: FloatArray, offset_m: FloatArray) -> FloatArray:
    """Add an offset (3,) to the positions of (..., 4, 4) poses."""
    shifted = pose.copy()
    shifted[..., :3, 3] += offset_m
    return shifted


def shift_trajectory(trajectory: Trajectory, offset_m: FloatArray) -> Trajectory:
    """Add an offset (3,) to the positions of a trajectory."""
    return replace(trajectory, world_from_vehicle=shift_poses(trajectory.world_from_vehicle, offset_m))


def shift_landmarks(landmarks: Landmarks, offset_m: FloatArray) -> Landmarks:
    """Add an offset (3,) to landmarks and their elevation arcs; covariances do not change."""
    return replace(landmarks, xyz_m=landmarks.xyz_m + offset_m, arc_m=landmarks.arc_m + offset_m)


def shift_reconstruction(reconstruction: Reconstruction, offset_m: FloatArray) -> Reconstruction:
    """Add an offset (3,) to the trajectory and the landmarks of a reconstruction."""
    return replace(
        reconstruction,
        trajectory=shift_trajectory(reconstruction.trajectory, offset_m),
        landmarks=shift_landmarks(reconstruction.landmarks, offset_m),
    )
