"""Summary of a sequence as rows of text for ``asfm info``."""

import numpy as np

from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import FloatArray, Frame, HandTracks, Trajectory

Row = tuple[str, str]

EVEN_SPACING_TOLERANCE = 1e-3
"""Beams are evenly spaced where their widths vary by less than this fraction of the mean width."""


def summarise_sequence(sequence: Sequence) -> list[Row]:
    """Summarise a sequence as (name, value with unit) rows.

    Only the first frame is read. Each diagnostic of the reader is a row of its own, named by its severity.

    Raises:
        AsfmError: the first frame cannot be read.
    """
    return [
        ("sequence", sequence.name),
        ("format", sequence.kind),
        ("frames", str(len(sequence))),
        *_describe_time(sequence),
        *_describe_sonar(sequence.sonar),
        ("odometry", _describe_trajectory(sequence.odometry)),
        ("navigation", _describe_navigation(sequence)),
        ("ground truth", _describe_trajectory(sequence.groundtruth)),
        ("hand tracks", _describe_hand_tracks(sequence.hand_tracks)),
        ("lever arm", _describe_lever_arm(sequence)),
        *_describe_frame(sequence.read_frame(0)),
        *((item.severity, str(item)) for item in sequence.diagnostics),
    ]


def path_length_m(trajectory: Trajectory) -> float:
    """Return the path length: the sum of the distances between consecutive poses."""
    steps_m = np.diff(trajectory.world_from_vehicle[:, :3, 3], axis=0)
    return float(np.linalg.norm(steps_m, axis=1).sum())


def _describe_time(sequence: Sequence) -> list[Row]:
    stamps_s = sequence.timestamps_s
    duration = ("duration", f"{stamps_s[-1] - stamps_s[0]:.2f} s")
    if len(stamps_s) == 1:
        return [duration, ("rate", "one frame")]
    gaps_s = np.diff(stamps_s)
    rate = f"{1 / np.median(gaps_s):.3g} Hz"
    if gaps_s.max() > 1.5 * np.median(gaps_s):
        rate += f", longest gap {gaps_s.max():.2f} s"
    return [duration, ("rate", rate)]


def _describe_sonar(sonar: SonarModel) -> list[Row]:
    near_m, far_m = sonar.range_edges_m[[0, -1]]
    widths_deg = np.degrees(np.diff(sonar.bearing_edges_rad))
    right_deg, left_deg = np.degrees(sonar.bearing_edges_rad[[0, -1]])
    is_even = np.ptp(widths_deg) <= EVEN_SPACING_TOLERANCE * widths_deg.mean()
    spacing = "evenly spaced" if is_even else f"unevenly spaced, {widths_deg.min():.3f} to {widths_deg.max():.3f} deg"
    return [
        ("sonar", sonar.name),
        ("image", f"{sonar.shape[0]} ranges x {sonar.shape[1]} beams"),
        ("range", f"{near_m:.3f} to {far_m:.3f} m, {1000 * sonar.range_step_m:.2f} mm a row"),
        (
            "bearing",
            f"{right_deg:.2f} to {left_deg:.2f} deg, {np.degrees(sonar.bearing_step_rad):.3f} deg a beam, {spacing}",
        ),
        ("elevation aperture", f"{np.degrees(sonar.elevation_aperture_rad):.1f} deg"),
    ]


def _describe_trajectory(trajectory: Trajectory | None) -> str:
    if trajectory is None:
        return "none"
    count = len(trajectory.timestamps_s)
    return f"{count} pose{'s' if count > 1 else ''}, path of {path_length_m(trajectory):.2f} m"


def _describe_navigation(sequence: Sequence) -> str:
    if sequence.navigation is None:
        return "none"
    z_m = sequence.navigation.z_m
    return f"{len(z_m)} readings, z from {z_m.min():.2f} to {z_m.max():.2f} m, {_explain_height(z_m)}"


def _explain_height(z_m: FloatArray) -> str:
    """Say where heights (N,) lie in a world whose z points up."""
    if z_m.min() > 0:
        return "above the origin (z points up: a depth must be negated)"
    return "below the origin (z points up)" if z_m.max() < 0 else "about the origin (z points up)"


def _describe_hand_tracks(tracks: HandTracks | None) -> str:
    if tracks is None:
        return "none"
    return f"{len(tracks.landmark)} observations of {len(np.unique(tracks.landmark))} landmarks"


def _describe_lever_arm(sequence: Sequence) -> str:
    from scipy.spatial.transform import Rotation  # slow to load

    pose = sequence.vehicle_from_sonar
    distance_m = float(np.linalg.norm(pose[:3, 3]))
    rotation_deg = float(np.degrees(Rotation.from_matrix(pose[:3, :3]).magnitude()))
    if distance_m < 1e-9 and rotation_deg < 1e-6:
        return "none: the vehicle's frame is the sonar's"
    return f"{distance_m:.3f} m, turned by {rotation_deg:.1f} deg"


def _describe_frame(frame: Frame) -> list[Row]:
    valid = frame.image[~frame.invalid]
    if valid.size == 0:
        echoes = "no valid pixel"
    else:
        echoes = f"mean {valid.mean():.3f}, 99 % below {np.quantile(valid, 0.99):.3f}, brightest {valid.max():.3f} of 1"
    return [
        ("invalid pixels", f"{100 * frame.invalid.mean():.2f} % of the first frame"),
        ("echo level", f"{echoes} (first frame)"),
    ]
