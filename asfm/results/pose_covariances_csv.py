"""pose_covariances.csv: the full covariance of every pose in the vehicle frame."""

from pathlib import Path

import numpy as np

from asfm.datasets.tables import parse_numbers, read_csv
from asfm.errors import AsfmError
from asfm.results.output_file import format_stamps, require_finite, write_lines
from asfm.types import FloatArray

DIRECTIONS = ("roll", "pitch", "yaw", "forward", "port", "up")
ROWS, COLUMNS = np.triu_indices(6)
HEADER = ("timestamp_s", *(f"{DIRECTIONS[i]}_{DIRECTIONS[j]}" for i, j in zip(ROWS, COLUMNS, strict=True)))


def write_pose_covariances(path: Path, timestamps_s: FloatArray, pose_covariance: FloatArray) -> None:
    """Write the upper triangle of every pose's covariance as CSV, in rad and m.

    Args:
        path: of the table.
        timestamps_s: (N,)
        pose_covariance: (N, 6, 6) rotation (rad) and translation (m) in the vehicle frame, as GTSAM's tangent space.

    Raises:
        AsfmError: the file cannot be written.
        ValueError: a number is not finite: a defect of the caller.
    """
    upper = pose_covariance[:, ROWS, COLUMNS]
    require_finite("pose covariances", timestamps_s, upper)
    stamps = format_stamps(timestamps_s)
    rows = [f"{stamp}," + ",".join(f"{value:.9e}" for value in row) for stamp, row in zip(stamps, upper, strict=True)]
    write_lines(path, [",".join(HEADER), *rows])


def read_pose_covariances(path: Path, frame_count: int) -> FloatArray:
    """Read the (N, 6, 6) covariances of a run on a sequence of N frames.

    Raises:
        AsfmError: the file cannot be read, a cell is not a finite number, or there are more or fewer rows than frames.
    """
    position, rows = read_csv(path, HEADER)
    if len(rows) != frame_count:
        raise AsfmError(f"{path}: expected a row for each of {frame_count} frames, found {len(rows)}")
    covariance = np.empty((len(rows), 6, 6))
    for name, i, j in zip(HEADER[1:], ROWS, COLUMNS, strict=True):
        covariance[:, i, j] = covariance[:, j, i] = parse_numbers(path, rows, position[name], name)
    return covariance
