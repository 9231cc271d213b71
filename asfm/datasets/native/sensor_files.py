"""Sensor files of the native folder: odometry.tum, groundtruth.tum, navigation.csv and landmarks.csv."""

from pathlib import Path

from asfm.datasets.tables import check_increasing, parse_integers, parse_numbers, read_csv, read_tum
from asfm.datasets.value_bounds import (
    MAX_BEARING_RAD,
    MAX_PITCH_RAD,
    MAX_ROLL_RAD,
    check_angles,
    check_lengths,
    check_stamps,
)
from asfm.diagnostics import Diagnostic, frame_runs
from asfm.errors import AsfmError
from asfm.regular_file import is_present
from asfm.types import FloatArray, HandTracks, Navigation, Trajectory

COVERAGE_TOLERANCE_S = 1e-3
"""Stamps in text are rounded: frames less than this outside a sensor's time span count as covered."""


def check_coverage(path: Path, timestamps_s: FloatArray, frames_s: FloatArray) -> list[Diagnostic]:
    """Check that the stamps of a sensor cover the frames.

    Args:
        path: file of the sensor, for messages.
        timestamps_s: (N,) stamps of the sensor.
        frames_s: (F,) stamps of the frames.

    Returns:
        A diagnostic that lists the frames outside, if any.

    Raises:
        AsfmError: the time spans do not overlap.
    """
    start, end = float(timestamps_s[0]), float(timestamps_s[-1])
    outside = (frames_s < start - COVERAGE_TOLERANCE_S) | (frames_s > end + COVERAGE_TOLERANCE_S)
    if not outside.any():
        return []
    spans = f"{start:.3f} to {end:.3f} s, the frames run from {frames_s[0]:.3f} to {frames_s[-1]:.3f} s"
    if outside.all() and (end < frames_s[0] or start > frames_s[-1]):
        raise AsfmError(f"{path}: it covers {spans}: no common time span; correct the stamps or remove the file")
    message = f"{path.name} covers {spans}: {outside.sum()} of {len(frames_s)} frames lie outside"
    return [Diagnostic("partial-sensor-coverage", message, frame_runs(outside))]


def read_trajectory(path: Path) -> Trajectory | None:
    """Read a trajectory in the TUM format, or return None where there is no file.

    Raises:
        AsfmError: as for :func:`asfm.datasets.tables.read_tum`.
    """
    return read_tum(path) if is_present(path) else None


def read_navigation(path: Path) -> Navigation | None:
    """Read depth and attitude from navigation.csv, or return None where there is no file.

    Raises:
        AsfmError: the table is invalid, its stamps do not increase, or an angle is beyond its natural bound.
    """
    if not is_present(path):
        return None
    names = ("timestamp_s", "z_m", "roll_rad", "pitch_rad")
    columns, rows = read_csv(path, names)
    timestamps_s, z_m, roll_rad, pitch_rad = (parse_numbers(path, rows, columns[name], name) for name in names)
    check_increasing(path, rows, timestamps_s)
    lines = [line for line, _ in rows]
    check_lengths(path, lines, z_m, "z_m")
    check_angles(path, lines, pitch_rad, "pitch_rad", MAX_PITCH_RAD)
    check_angles(path, lines, roll_rad, "roll_rad", MAX_ROLL_RAD)
    return Navigation(timestamps_s, z_m, roll_rad, pitch_rad)


def read_hand_tracks(path: Path) -> HandTracks | None:
    """Read hand-tracked points from landmarks.csv, or return None where there is no file.

    Raises:
        AsfmError: the table is invalid, or a stamp or bearing is beyond its natural bound.
    """
    if not is_present(path):
        return None
    columns, rows = read_csv(path, ("timestamp_s", "landmark", "range_m", "bearing_rad"))
    timestamps_s, range_m, bearing_rad = (
        parse_numbers(path, rows, columns[name], name) for name in ("timestamp_s", "range_m", "bearing_rad")
    )
    lines = [line for line, _ in rows]
    check_stamps(path, timestamps_s, lines)
    check_lengths(path, lines, range_m, "range_m")
    check_angles(path, lines, bearing_rad, "bearing_rad", MAX_BEARING_RAD)
    landmark = parse_integers(path, rows, columns["landmark"], "landmark")
    return HandTracks(timestamps_s, landmark, range_m, bearing_rad)
