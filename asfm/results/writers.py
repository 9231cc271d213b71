"""Writing results: trajectory (TUM), points (PLY), tracks (CSV), report (JSON), and what their folder looks like."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from asfm.atomic_folder import FolderKind
from asfm.errors import AsfmError
from asfm.geometry.poses import tum_from_pose
from asfm.types import BoolArray, FloatArray, Landmarks, Tracks, Trajectory

RESULTS = FolderKind(
    name="results",
    marks=("report.json", "config.yaml"),
    patterns=(
        *("trajectory.tum", "points.ply", "pose_sigmas.csv", "tracks.csv", "reconstruction.rrd"),
        *("report.json", "config.yaml", "evaluation.json"),
        ".evaluation.json.partial",  # asfm evaluate, stopped at the wrong moment
    ),
)
"""The folder that asfm run writes."""


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Write world_from_vehicle as TUM rows: stamps exactly, positions to 1 nm, quaternions to 1e-9.

    Raises:
        AsfmError: the file cannot be written.
        ValueError: a pose or stamp is not finite, or as many stamps as poses are not there: a defect of the caller.
    """
    rows = tum_from_pose(trajectory.world_from_vehicle)
    if len(rows) != len(trajectory.timestamps_s):
        raise ValueError(f"{len(trajectory.timestamps_s)} stamps for {len(rows)} poses")
    _require_finite("trajectory", trajectory.timestamps_s, rows)
    stamps = [np.format_float_positional(stamp, trim="0") for stamp in trajectory.timestamps_s]
    rows = np.round(rows, 9) + 0.0  # a negative zero becomes zero
    lines = [f"{stamp} " + " ".join(f"{value:.9f}" for value in row) for stamp, row in zip(stamps, rows, strict=True)]
    _write(path, "\n".join(["# timestamp x y z qx qy qz qw", *lines, ""]).encode())


def write_pose_sigmas(path: Path, timestamps_s: FloatArray, pose_covariance: FloatArray) -> None:
    """Write the standard deviations of every pose as CSV, in the vehicle's frame.

    Args:
        path: of the table.
        timestamps_s: (N,)
        pose_covariance: (N, 6, 6) rotation and translation.

    Raises:
        AsfmError: the file cannot be written.
        ValueError: a number is not finite: a defect of the caller.
    """
    sigma = np.sqrt(np.maximum(np.diagonal(pose_covariance, axis1=1, axis2=2), 0))
    _require_finite("pose sigmas", timestamps_s, sigma)
    stamps = [np.format_float_positional(stamp, trim="0") for stamp in timestamps_s]
    rows = [f"{stamp}," + ",".join(f"{value:.9f}" for value in row) for stamp, row in zip(stamps, sigma, strict=True)]
    header = "timestamp_s,roll_rad,pitch_rad,yaw_rad,forward_m,port_m,up_m"
    _write(path, "\n".join([header, *rows, ""]).encode())


def write_points(path: Path, landmarks: Landmarks) -> None:
    """Write landmarks as binary little-endian PLY: x y z sigma_m (metres), views, well_constrained (1 or 0).

    Raises:
        AsfmError: the file cannot be written.
        ValueError: a coordinate or sigma is not finite: a defect of the caller.
    """
    _require_finite("landmarks", landmarks.xyz_m, landmarks.sigma_m)
    columns: dict[str, tuple[str, str, Any]] = {
        "x": ("<f8", "double", landmarks.xyz_m[:, 0]),
        "y": ("<f8", "double", landmarks.xyz_m[:, 1]),
        "z": ("<f8", "double", landmarks.xyz_m[:, 2]),
        "sigma_m": ("<f4", "float", landmarks.sigma_m),
        "views": ("<i4", "int", landmarks.views),
        "well_constrained": ("u1", "uchar", landmarks.well_constrained),
    }
    vertices = np.empty(len(landmarks), dtype=[(name, kind) for name, (kind, _, _) in columns.items()])
    for name, (_, _, values) in columns.items():
        vertices[name] = values
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment asfm landmarks in metres; well_constrained 0 marks points whose elevation is not known",
        f"element vertex {len(landmarks)}",
        *(f"property {kind} {name}" for name, (_, kind, _) in columns.items()),
        "end_header",
        "",
    ]
    _write(path, "\n".join(header).encode() + vertices.tobytes())


def write_tracks(path: Path, tracks: Tracks, observed: BoolArray) -> None:
    """Write every observation as a CSV row, numbers as exactly as they are held, and whether the run used it: 1 or 0.

    Cells of sigma stay empty where the tracks state none.

    Args:
        path: of the table.
        tracks: (O,) observations.
        observed: (O,) which of them entered the final graph.

    Raises:
        AsfmError: the file cannot be written.
        ValueError: a number is not finite: a defect of the caller.
    """
    numbers = [tracks.range_m, tracks.bearing_rad]
    numbers += [] if tracks.sigma is None else [tracks.sigma[:, 0], tracks.sigma[:, 1]]
    _require_finite("tracks", *numbers)
    texts = [[repr(value) for value in column.tolist()] for column in numbers]
    texts += [] if tracks.sigma is not None else [[""] * len(tracks)] * 2
    whole = [[str(value) for value in column.tolist()] for column in (tracks.track, tracks.frame, observed.astype(int))]
    rows = zip(*whole[:2], *texts, whole[2], strict=True)
    header = "track,frame,range_m,bearing_rad,sigma_range_m,sigma_bearing_rad,used"
    _write(path, "\n".join([header, *map(",".join, rows), ""]).encode())


def write_report(path: Path, report: dict[str, Any]) -> None:
    """Write a report as indented JSON with sorted keys; numpy numbers, arrays and paths become plain ones.

    Raises:
        AsfmError: the file cannot be written.
        ValueError: a value is not finite or not of JSON, named by its key: a defect of the caller.
    """
    text = json.dumps(_plain(report, "report"), allow_nan=False, sort_keys=True, indent=2, ensure_ascii=False)
    _write(path, (text + "\n").encode())


def _write(path: Path, data: bytes) -> None:
    try:
        path.write_bytes(data)
    except OSError as error:
        raise AsfmError(f"{path}: cannot write: {error.strerror}") from None


def _require_finite(what: str, *arrays: np.ndarray[Any, np.dtype[np.float64]]) -> None:
    for array in arrays:
        bad = np.argwhere(~np.isfinite(array))
        if len(bad):
            raise ValueError(f"{what}: row {bad[0][0]} is not finite")


def _plain(value: Any, where: str) -> Any:
    """Turn numpy values and paths into JSON's own types; name the key of what JSON cannot hold."""
    if isinstance(value, dict):
        return {str(key): _plain(item, f"{where}.{key}") for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, f"{where}[{index}]") for index, item in enumerate(value)]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist(), where)
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float) and not np.isfinite(value):
        raise ValueError(f"{where} is {value}: a report holds finite numbers, or None where there is none")
    if value is None or isinstance(value, str | int | float):
        return value
    raise ValueError(f"{where} is a {type(value).__name__}: not a JSON value")
