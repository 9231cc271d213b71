"""trajectory.tum: the estimated trajectory in TUM format."""

from pathlib import Path

import numpy as np

from asfm.datasets.tables import read_tum
from asfm.geometry.poses import tum_from_pose
from asfm.results.output_file import format_stamps, require_finite, write_lines
from asfm.types import Trajectory

HEADER = "# timestamp x y z qx qy qz qw"


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Write world_from_vehicle as TUM rows: stamps exactly, positions to 1 nm, quaternions to 1e-9.

    Raises:
        AsfmError: the file cannot be written.
        ValueError: a pose or stamp is not finite, or there are not as many stamps as poses: a defect of the caller.
    """
    rows = tum_from_pose(trajectory.world_from_vehicle)
    if len(rows) != len(trajectory.timestamps_s):
        raise ValueError(f"expected one stamp per pose, found {len(trajectory.timestamps_s)} for {len(rows)} poses")
    require_finite("trajectory", trajectory.timestamps_s, rows)
    stamps = format_stamps(trajectory.timestamps_s)
    rows = np.round(rows, 9) + 0.0  # a negative zero becomes zero
    lines = [f"{stamp} " + " ".join(f"{value:.9f}" for value in row) for stamp, row in zip(stamps, rows, strict=True)]
    write_lines(path, [HEADER, *lines])


def read_trajectory(path: Path) -> Trajectory:
    """Read the trajectory of a run: world_from_vehicle, one pose per frame.

    Raises:
        AsfmError: the file cannot be read, or a row is not a pose; names file and line.
    """
    return read_tum(path)
