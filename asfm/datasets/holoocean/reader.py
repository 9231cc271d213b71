"""Reader of HoloOcean recordings in the layout of NeuSIS and AONeuS: Config.json and one pickle per frame.

A pickle holds the state of one tick, {"ImagingSonar": (ranges, beams), "PoseSensor": 4 x 4 world_from_sonar, "t": s}.
Row 0 is nearest and column 0 is starboard, as everywhere in asfm.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from asfm.datasets.holoocean.config_json import Scenario, read_scenario
from asfm.datasets.holoocean.pixel_scale import choose_scale
from asfm.datasets.holoocean.ticks import Tick, load_state, read_image, read_ticks
from asfm.datasets.images import scale_to_unit
from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError
from asfm.geometry.sonar import SonarModel
from asfm.regular_file import check_inside, is_present
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, Frame, ImageArray, Trajectory


@dataclass(frozen=True)
class PickledFrames:
    """Location of the images of one recording."""

    timestamps_s: FloatArray
    paths: tuple[Path, ...]
    sonar_name: str
    shape: tuple[int, int]
    """(ranges, beams)"""
    scale: float = 1.0
    """Image value per unit of the pixels that are floats."""


def is_holoocean(path: Path) -> bool:
    """Return whether a folder, or its parent, holds Config.json and pickles."""
    return _find_folders(path) is not None


def read_holoocean(path: Path) -> Sequence:
    """Open a folder of pickles; all are read once for poses and times, and again for each image on demand.

    Args:
        path: the folder of Config.json, or that of the pickles.

    Returns:
        The sequence. Its ground truth is the poses of the PoseSensor, the vehicle's frame being the sonar's. Its stamps
        are the recorded times where all pickles have them and they increase, else the frame number over the sonar's
        rate.

    Raises:
        AsfmError: Config.json or a pickle is missing, damaged or inconsistent with the others; the message names it.
    """
    folders = _find_folders(path)
    if folders is None:
        raise AsfmError(f"{path}: expected Config.json and pickles (*.pkl) in it or in Data, found none")
    root, data = folders
    check_inside(root, root / "Config.json", "a HoloOcean scenario")
    check_inside(root, data, "a folder of pickles")
    scenario = read_scenario(root / "Config.json")
    diagnostics: list[Diagnostic] = []
    ticks = read_ticks(data, scenario, diagnostics)
    scenario.check_shape(ticks[0].shape, ticks[0].path)
    timestamps_s = _choose_timestamps(ticks, scenario, diagnostics)
    scale = choose_scale(data, [tick.levels for tick in ticks if tick.levels is not None], diagnostics)
    paths = tuple(tick.path for tick in ticks)
    frames = PickledFrames(timestamps_s, paths, scenario.sonar_name, ticks[0].shape, scale)
    return Sequence(
        name=root.resolve().name,
        sonar=_make_sonar(scenario, frames.shape),
        timestamps_s=timestamps_s,
        read_frame=partial(read_pickled_frame, frames),
        groundtruth=_collect_groundtruth(ticks, timestamps_s, scenario, diagnostics),
        kind="holoocean",
        diagnostics=tuple(diagnostics),
        check_frames=partial(_check_shapes, ticks, scenario.sonar_name),
    )


def read_pickled_frame(frames: PickledFrames, index: int) -> Frame:
    """Read one image, scaled and clipped to 0..1; pixels that are not finite become 0 and invalid.

    Raises:
        AsfmError: the pickle cannot be read, or its image has another shape.
        IndexError: there is no such frame.
    """
    if not 0 <= index < len(frames.paths):
        raise IndexError(f"frame {index} of a sequence with frames 0..{len(frames.paths) - 1}")
    path = frames.paths[index]
    pixels = read_image(path, load_state(path), frames.sonar_name)
    _check_shape(path, frames.sonar_name, pixels.shape, frames.shape)
    return Frame(index, float(frames.timestamps_s[index]), *_unit_image(pixels, frames.scale))


def _check_shapes(ticks: list[Tick], name: str) -> None:
    for tick in ticks:
        _check_shape(tick.path, name, tick.shape, ticks[0].shape)


def _check_shape(path: Path, name: str, found: tuple[int, ...], expected: tuple[int, int]) -> None:
    if found != expected:
        raise AsfmError(
            f"{path}: expected {name} of shape {expected} (ranges, beams) as in the first pickle, found {found}"
        )


def _find_folders(path: Path) -> tuple[Path, Path] | None:
    """Return the folder of Config.json and the folder of the pickles, or None where there are none."""
    for root, data in ((path, path / "Data"), (path, path), (path.resolve().parent, path)):
        if is_present(root / "Config.json") and data.is_dir() and next(data.glob("*.pkl"), None) is not None:
            return root, data
    return None


def _make_sonar(scenario: Scenario, shape: tuple[int, int]) -> SonarModel:
    return SonarModel.evenly_spaced(
        name=f"HoloOcean {scenario.sonar_name}",
        range_m=scenario.range_m,
        bearing_rad=(-scenario.azimuth_rad / 2, scenario.azimuth_rad / 2),
        shape=shape,
        elevation_aperture_rad=scenario.elevation_rad,
    )


def _choose_timestamps(ticks: list[Tick], scenario: Scenario, diagnostics: list[Diagnostic]) -> FloatArray:
    """Return the stamps (N,) in seconds: recorded, or nominal where those cannot be used."""
    nominal_s = np.arange(len(ticks)) / scenario.rate_hz
    times_s = [tick.time_s for tick in ticks if tick.time_s is not None]
    if not times_s:
        return nominal_s
    if len(times_s) == len(ticks) and np.all(np.diff(times_s) > 0):
        return np.array(times_s)
    missing = len(ticks) - len(times_s)
    reason = f"are missing from {missing} pickles" if missing else "do not increase"
    message = f"the recorded times {reason}: frames are stamped at the sonar's nominal {scenario.rate_hz:g} Hz"
    diagnostics.append(Diagnostic("unreliable-stamps", message))
    return nominal_s


def _collect_groundtruth(
    ticks: list[Tick], timestamps_s: FloatArray, scenario: Scenario, diagnostics: list[Diagnostic]
) -> Trajectory | None:
    """Return the poses of the ticks that have one, or None where there are none or they are not the sonar's."""
    if not scenario.pose_is_of_sonar:
        message = (
            "PoseSensor and sonar differ in socket, location or rotation in Config.json: its poses are not the sonar's "
            "and are left out"
        )
        diagnostics.append(Diagnostic("pose-not-of-sonar", message))
        return None
    known = [index for index, tick in enumerate(ticks) if tick.world_from_sonar is not None]
    if not known:
        return None
    poses = [tick.world_from_sonar for tick in ticks if tick.world_from_sonar is not None]
    return Trajectory(timestamps_s[known], np.stack(poses))


def _unit_image(pixels: Any, scale: float) -> tuple[ImageArray, BoolArray]:
    """Return the image in 0..1 and its mask of invalid pixels, both (ranges, beams)."""
    if pixels.dtype == np.uint8:
        return scale_to_unit(pixels), np.zeros(pixels.shape, dtype=bool)
    invalid = ~np.isfinite(pixels)
    image = np.where(invalid, 0, pixels).astype(np.float32)
    return np.clip(image * np.float32(scale), 0.0, 1.0), invalid
