"""Trajectories moved to a common first pose, and the distance of each from ground truth."""

import numpy as np

from asfm.geometry.local_origin import shift_poses
from asfm.geometry.poses import interpolate, invert
from asfm.sequence import Sequence
from asfm.types import FloatArray, Trajectory


def collect_trajectories(sequence: Sequence, estimate: Trajectory) -> dict[str, Trajectory]:
    """Return estimate, odometry and groundtruth, as far as they exist, moved to the estimate's first pose."""
    named = {"estimate": estimate, "odometry": sequence.odometry, "groundtruth": sequence.groundtruth}
    moved = {name: align_first_pose(line, estimate) for name, line in named.items() if line is not None}
    return {name: line for name, line in moved.items() if len(line.timestamps_s)}


def align_first_pose(trajectory: Trajectory, estimate: Trajectory) -> Trajectory:
    """Interpolate a trajectory at the stamps of the estimate, and move it to the estimate's first common pose.

    Returns:
        The poses at the stamps that the trajectory covers; none where the two do not overlap in time.
    """
    stamps_s = estimate.timestamps_s
    stamps_s = stamps_s[(stamps_s >= trajectory.timestamps_s[0]) & (stamps_s <= trajectory.timestamps_s[-1])]
    if not len(stamps_s):
        return Trajectory(stamps_s, np.zeros((0, 4, 4)))
    poses = interpolate(trajectory.timestamps_s, trajectory.world_from_vehicle, stamps_s)
    start = interpolate(estimate.timestamps_s, estimate.world_from_vehicle, stamps_s[:1])
    poses = shift_poses(poses, -poses[0, :3, 3])  # small numbers: a rotation about a far origin loses digits
    return Trajectory(stamps_s, start @ invert(poses[:1]) @ poses)


def measure_drift(trajectory: Trajectory, groundtruth: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Compute the distance of a trajectory from ground truth, with both aligned at the first common pose.

    Returns:
        The (N,) stamps of the trajectory that the ground truth covers, and the (N,) distances there in m.
    """
    truth = align_first_pose(groundtruth, trajectory)
    covered = np.isin(trajectory.timestamps_s, truth.timestamps_s)
    gap_m = trajectory.world_from_vehicle[covered, :3, 3] - truth.world_from_vehicle[:, :3, 3]
    return truth.timestamps_s, np.linalg.norm(gap_m, axis=1)
