"""Writer of the native sequence folder, which streams the frames one at a time."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydantic import ValidationError

from asfm.atomic_folder import FolderKind, atomic_folder
from asfm.datasets.images import Bits, encode_png, quantise
from asfm.datasets.native.sequence_yaml import MountSettings, NoiseSettings, SequenceSettings, SonarSettings, explain
from asfm.datasets.native.truth import write_truth_file
from asfm.errors import AsfmError
from asfm.geometry.poses import tum_from_pose
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import Frame, FrameTruth, Trajectory

EVEN_SPACING_TOLERANCE = 1e-9
"""In m and rad: rows or beams that deviate by less from an even spacing are written as two outer edges."""

NATIVE = FolderKind(
    name="a sequence",
    marks=("sequence.yaml", "frames.csv"),
    patterns=(
        *("sequence.yaml", "frames.csv", "odometry.tum", "navigation.csv", "groundtruth.tum", "landmarks.csv"),
        *("frames", "frames/*[0-9].png", "invalid", "invalid/*[0-9].png", "truth", "truth/*[0-9].npz"),
    ),
)


def write_native(
    folder: Path,
    sequence: Sequence,
    truth: Callable[[int], FrameTruth] | None = None,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
    bits: Bits = 8,
) -> None:
    """Write a sequence as a native folder, which appears only when it is complete.

    Args:
        folder: the folder to write.
        sequence: its frames are read one at a time, each once and in order.
        truth: returns the truth of frame i; called right after frame i was read.
        overwrite: replace an existing native folder.
        progress: called with (frames written, total) after each frame.
        bits: 8 or 16 bits per pixel.

    Raises:
        AsfmError: the folder exists or cannot be written, a frame has another shape than its sonar or values outside
            0..1, or the sequence cannot be described by sequence.yaml, such as one with unevenly spaced ranges.
    """
    _dump_settings(folder, sequence, None)  # raises before anything is written
    decibel_span = None
    with atomic_folder(folder, NATIVE, overwrite) as partial:
        rows = []
        for index in range(len(sequence)):
            frame = sequence.read_frame(index)
            decibel_span = frame.decibel_span
            rows.append(_write_frame(partial, sequence, index, frame, bits))
            if truth is not None:
                (partial / "truth").mkdir(exist_ok=True)
                write_truth_file(partial / "truth" / f"{index:06d}.npz", truth(index), bits)
            if progress is not None:
                progress(index + 1, len(sequence))
        _write_frames_table(partial / "frames.csv", rows)
        _write_sensors(partial, sequence)
        _write_lines(partial / "sequence.yaml", [_dump_settings(folder, sequence, decibel_span).rstrip("\n")])


def _write_frame(folder: Path, sequence: Sequence, index: int, frame: Frame, bits: Bits) -> tuple[float, str, str]:
    """Write one image, and its mask if it has invalid pixels, and return its row of frames.csv."""
    for name, array in (("image", frame.image), ("invalid mask", frame.invalid)):
        if array.shape != sequence.sonar.shape:
            raise AsfmError(
                f"{sequence.name}, frame {index}: expected an {name} of shape {sequence.sonar.shape} (ranges, beams), "
                f"found {array.shape}"
            )
    if not (np.all(frame.image >= 0) and np.all(frame.image <= 1)):
        raise AsfmError(
            f"{sequence.name}, frame {index}: expected echo strengths in 0..1, "
            f"found {float(np.min(frame.image))}..{float(np.max(frame.image))}"
        )
    image_name, mask_name = f"frames/{index:06d}.png", ""
    _write_bytes(folder / image_name, encode_png(quantise(frame.image, bits)))
    if frame.invalid.any():
        mask_name = f"invalid/{index:06d}.png"
        _write_bytes(folder / mask_name, encode_png(np.where(frame.invalid, 255, 0).astype(np.uint8)))
    return float(sequence.timestamps_s[index]), image_name, mask_name


def _write_frames_table(path: Path, rows: list[tuple[float, str, str]]) -> None:
    has_masks = any(mask for _, _, mask in rows)
    lines = [f"{stamp!r},{image},{mask}" if has_masks else f"{stamp!r},{image}" for stamp, image, mask in rows]
    _write_lines(path, ["timestamp_s,image" + (",invalid_mask" if has_masks else ""), *lines])


def _write_sensors(folder: Path, sequence: Sequence) -> None:
    for name, trajectory in (("odometry", sequence.odometry), ("groundtruth", sequence.groundtruth)):
        if trajectory is not None:
            _write_lines(folder / f"{name}.tum", _tum_lines(trajectory))
    if sequence.navigation is not None:
        readings = sequence.navigation
        columns = (readings.timestamps_s, readings.z_m, readings.roll_rad, readings.pitch_rad)
        _write_lines(
            folder / "navigation.csv", ["timestamp_s,z_m,roll_rad,pitch_rad", *_join(zip(*columns, strict=True))]
        )
    if sequence.hand_tracks is not None:
        tracks = sequence.hand_tracks
        points = (tracks.timestamps_s, tracks.landmark, tracks.range_m, tracks.bearing_rad)
        _write_lines(
            folder / "landmarks.csv", ["timestamp_s,landmark,range_m,bearing_rad", *_join(zip(*points, strict=True))]
        )


def _tum_lines(trajectory: Trajectory) -> list[str]:
    rows = np.column_stack([trajectory.timestamps_s, tum_from_pose(trajectory.world_from_vehicle)])
    return _join(rows, separator=" ")


def _join(rows: Iterable[Iterable[Any]], separator: str = ",") -> list[str]:
    """Join the cells of each row; the text of a number reads back as the same number."""
    return [separator.join(repr(value.item()) for value in row) for row in rows]


def _dump_settings(folder: Path, sequence: Sequence, decibel_span: float | None) -> str:
    try:
        settings = SequenceSettings(
            sonar=_sonar_settings(folder, sequence.sonar, decibel_span),
            vehicle_from_sonar=MountSettings.from_pose(sequence.vehicle_from_sonar),
            noise=NoiseSettings.from_sensor_noise(sequence.noise),
        )
    except ValidationError as error:
        raise AsfmError(explain(error, f"{folder}: cannot describe the sequence {sequence.name}")) from None
    return yaml.safe_dump(settings.model_dump(mode="json", exclude_none=True), sort_keys=False, default_flow_style=None)


def _sonar_settings(folder: Path, sonar: SonarModel, decibel_span: float | None) -> SonarSettings:
    """Describe the pixel grid by its outer edges, or by every bearing where the beams are unevenly spaced."""
    range_edges_m, bearing_edges_rad = sonar.range_edges_m, sonar.bearing_edges_rad
    range_m = (_round_off(range_edges_m[0]), _round_off(range_edges_m[-1]))
    outer_rad = (float(bearing_edges_rad[0]), float(bearing_edges_rad[-1]))
    even = SonarModel.evenly_spaced(sonar.name, range_m, outer_rad, sonar.shape, sonar.elevation_aperture_rad)
    if np.abs(even.range_m - sonar.range_m).max() > EVEN_SPACING_TOLERANCE + 1e-6 * sonar.range_step_m:
        raise AsfmError(f"{folder}: expected evenly spaced ranges, found uneven ones: resample the images first")
    is_even = np.abs(even.bearing_rad - sonar.bearing_rad).max() <= EVEN_SPACING_TOLERANCE
    return SonarSettings(
        name=sonar.name,
        range_m=range_m,
        bearing_deg=(_round_off(np.degrees(outer_rad[0])), _round_off(np.degrees(outer_rad[1]))) if is_even else None,
        bearings_deg=None if is_even else tuple(np.degrees(sonar.bearing_rad).tolist()),
        elevation_aperture_deg=_round_off(np.degrees(sonar.elevation_aperture_rad)),
        decibel_span=decibel_span,
    )


def _round_off(value: float) -> float:
    """Remove the rounding error of converting degrees to radians and back, far below a beam or a row."""
    return round(float(value), 10)


def _write_bytes(path: Path, content: bytes) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)


def _write_lines(path: Path, lines: list[str]) -> None:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
