"""pose_sigmas.csv: standard deviations of every pose in the vehicle frame."""

from pathlib import Path

import numpy as np

from asfm.results.output_file import format_stamps, require_finite, write_lines
from asfm.types import FloatArray

COLUMNS = ("timestamp_s", "roll_rad", "pitch_rad", "yaw_rad", "forward_m", "port_m", "up_m")


def write_pose_sigmas(path: Path, timestamps_s: FloatArray, pose_covariance: FloatArray) -> None:
    """Write the square roots of the diagonals of the pose covariances as CSV.

    Args:
        path: of the table.
        timestamps_s: (N,)
        pose_covariance: (N, 6, 6) rotation (rad) and translation (m) in the vehicle frame.

    Raises:
        AsfmError: the file cannot be written.
        ValueError: a number is not finite: a defect of the caller.
    """
    sigma = np.sqrt(np.maximum(np.diagonal(pose_covariance, axis1=1, axis2=2), 0))
    require_finite("pose sigmas", timestamps_s, sigma)
    stamps = format_stamps(timestamps_s)
    rows = [f"{stamp}," + ",".join(f"{value:.9f}" for value in row) for stamp, row in zip(stamps, sigma, strict=True)]
    write_lines(path, [",".join(COLUMNS), *rows])
