"""Reader of the native sequence folder: text files are parsed on opening, images are read on demand."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from asfm.datasets.images import check_png_shape, read_grey_png, read_png_shape, scale_to_unit
from asfm.datasets.native.folder_contents import check_image_order, find_unused_files
from asfm.datasets.native.image_paths import check_places, locate_images
from asfm.datasets.native.sensor_files import check_coverage, read_hand_tracks, read_navigation, read_trajectory
from asfm.datasets.native.sequence_yaml import SonarSettings, read_settings
from asfm.datasets.native.truth import read_truth_file
from asfm.datasets.tables import check_increasing, parse_numbers, read_csv
from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError
from asfm.geometry.sonar import SonarModel
from asfm.regular_file import check_inside, is_present
from asfm.sequence import Sequence
from asfm.types import FloatArray, Frame, FrameTruth


@dataclass(frozen=True)
class NativeFrames:
    """Location and format of the images of a native folder."""

    timestamps_s: FloatArray
    images: tuple[Path, ...]
    invalid_masks: tuple[Path | None, ...]
    shape: tuple[int, int]
    """(ranges, beams) of the first image; all others must have the same."""
    descending: bool
    """Whether column 0 on disk is the port-most beam, so that images are flipped on reading."""
    decibel_span: float | None = None
    """Decibels from black to white, where the images are logarithmic."""


def is_native(path: Path) -> bool:
    """Return whether a path is a native sequence folder."""
    return path.is_dir() and is_present(path / "sequence.yaml")


def read_native(folder: Path) -> Sequence:
    """Open a native sequence folder.

    Raises:
        AsfmError: a file is missing or invalid; the message names the file, the row, what was expected and found.
    """
    check_places(folder)
    settings = read_settings(folder / "sequence.yaml")
    frames, sonar, diagnostics = _locate_frames(folder, settings.sonar)
    timestamps_s = frames.timestamps_s
    odometry = read_trajectory(folder / "odometry.tum")
    navigation = read_navigation(folder / "navigation.csv")
    diagnostics += find_unused_files(folder)
    if odometry is not None:
        diagnostics += check_coverage(folder / "odometry.tum", odometry.timestamps_s, timestamps_s)
    if navigation is not None:
        diagnostics += check_coverage(folder / "navigation.csv", navigation.timestamps_s, timestamps_s)
    return Sequence(
        name=folder.resolve().name,
        sonar=sonar,
        timestamps_s=timestamps_s,
        read_frame=partial(read_native_frame, frames),
        vehicle_from_sonar=settings.vehicle_from_sonar.pose(),
        odometry=odometry,
        navigation=navigation,
        groundtruth=read_trajectory(folder / "groundtruth.tum"),
        noise=settings.noise.sensor_noise(),
        hand_tracks=read_hand_tracks(folder / "landmarks.csv"),
        kind="native",
        diagnostics=tuple(diagnostics),
        check_frames=partial(check_native_frames, frames),
    )


def open_native_truth(folder: Path) -> Callable[[int], FrameTruth] | None:
    """Return a function that reads the truth of frame i, or None where the folder holds no truth.

    The file name of a frame's truth is that of its image, with the suffix .npz.

    Raises:
        AsfmError: as for :func:`read_native`; the function itself raises it for an invalid file of truth.
    """
    if not is_present(folder / "truth"):
        return None
    check_inside(folder, folder / "truth", "true elevations")
    return partial(_read_frame_truth, folder / "truth", locate_native_frames(folder))


def locate_native_frames(folder: Path) -> NativeFrames:
    """Locate the images of a native folder.

    Raises:
        AsfmError: as for :func:`read_native`.
    """
    return _locate_frames(folder, read_settings(folder / "sequence.yaml").sonar)[0]


def check_native_frames(frames: NativeFrames) -> None:
    """Check the headers of all images and masks without decoding them.

    Raises:
        AsfmError: a file is missing, not a PNG, not grey or of another size than the first image.
    """
    for path in dict.fromkeys((*frames.images, *filter(None, frames.invalid_masks))):
        check_png_shape(path, frames.shape)


def read_native_frame(frames: NativeFrames, index: int) -> Frame:
    """Read one image and its mask, flipped where needed so that column 0 is starboard.

    Raises:
        AsfmError: the image or its mask is missing, damaged or of another size.
        IndexError: there is no such frame.
    """
    if not 0 <= index < len(frames.images):
        raise IndexError(f"frame {index} of a sequence with frames 0..{len(frames.images) - 1}")
    image = scale_to_unit(read_grey_png(frames.images[index], frames.shape))
    mask_path = frames.invalid_masks[index]
    invalid = np.zeros(frames.shape, dtype=bool) if mask_path is None else read_grey_png(mask_path, frames.shape) > 0
    if frames.descending:
        image, invalid = np.ascontiguousarray(image[:, ::-1]), np.ascontiguousarray(invalid[:, ::-1])
    return Frame(index, float(frames.timestamps_s[index]), image, invalid, frames.decibel_span)


def make_sonar(settings: SonarSettings, shape: tuple[int, int], path: Path) -> tuple[SonarModel, bool]:
    """Make the sonar model of a native folder.

    Args:
        settings: of sequence.yaml.
        shape: (ranges, beams) of the images.
        path: sequence.yaml, for messages.

    Returns:
        The sonar model, and whether the columns on disk run from port to starboard.

    Raises:
        AsfmError: the images are too small, or bearings_deg has not one value per column.
    """
    if min(shape) < 2:
        raise AsfmError(f"{path}: expected images of at least 2 x 2 pixels, found {shape[0]} x {shape[1]}")
    aperture_rad = float(np.radians(settings.elevation_aperture_deg))
    if settings.bearing_deg is not None:
        first_rad, last_rad = (float(np.radians(edge)) for edge in settings.bearing_deg)
        edges_rad = (min(first_rad, last_rad), max(first_rad, last_rad))
        model = SonarModel.evenly_spaced(settings.name, settings.range_m, edges_rad, shape, aperture_rad)
        return model, first_rad > last_rad
    bearings_rad = np.radians(np.array(settings.bearings_deg))
    if len(bearings_rad) != shape[1]:
        raise AsfmError(
            f"{path}: expected {shape[1]} sonar.bearings_deg, one for each column of the first image, "
            f"found {len(bearings_rad)}"
        )
    even = SonarModel.evenly_spaced(settings.name, settings.range_m, (-1.0, 1.0), shape, aperture_rad)
    model = SonarModel(settings.name, even.range_m, np.sort(bearings_rad), aperture_rad)
    return model, bool(bearings_rad[0] > bearings_rad[-1])


def _locate_frames(folder: Path, settings: SonarSettings) -> tuple[NativeFrames, SonarModel, list[Diagnostic]]:
    """Read frames.csv and the size of the first image; also return remarks on the order of the images."""
    timestamps_s, images, invalid_masks, diagnostics = _read_frames_table(folder)
    shape = read_png_shape(images[0])
    sonar, descending = make_sonar(settings, shape, folder / "sequence.yaml")
    frames = NativeFrames(timestamps_s, images, invalid_masks, shape, descending, settings.decibel_span)
    return frames, sonar, diagnostics


def _read_frame_truth(folder: Path, frames: NativeFrames, index: int) -> FrameTruth:
    path = folder / frames.images[index].with_suffix(".npz").name
    check_inside(folder.parent, path, "the truth of a frame")
    return read_truth_file(path, frames.shape, frames.descending)


def _read_frames_table(
    folder: Path,
) -> tuple[FloatArray, tuple[Path, ...], tuple[Path | None, ...], list[Diagnostic]]:
    """Read frames.csv: stamps (N,), images, masks, None where a frame has no mask, and remarks on their order."""
    path = folder / "frames.csv"
    columns, rows = read_csv(path, ("timestamp_s", "image"), ("invalid_mask",))
    timestamps_s = parse_numbers(path, rows, columns["timestamp_s"], "timestamp_s")
    check_increasing(path, rows, timestamps_s)
    images = [image for image in locate_images(path, rows, columns["image"]) if image is not None]
    for line, cells in rows:
        if not cells[columns["image"]]:
            raise AsfmError(f"{path}, line {line}: expected the name of an image, found an empty cell")
    remarks = check_image_order(path, rows, columns["image"])
    mask_column = columns.get("invalid_mask")
    masks = [None] * len(images) if mask_column is None else locate_images(path, rows, mask_column)
    return timestamps_s, tuple(images), tuple(masks), remarks
