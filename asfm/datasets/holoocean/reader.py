"""Reader of HoloOcean recordings as NeuSIS and AONeuS keep them: Config.json and one pickle a frame.

A pickle holds the state of one tick, {"ImagingSonar": (ranges, beams), "PoseSensor": 4 x 4 world_from_sonar, "t": s}.
Row 0 is nearest and column 0 starboard; both agree with the conventions inside.
"""

import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.datasets.holoocean.config_json import Scenario, read_scenario
from asfm.datasets.holoocean.safe_pickle import load_pickle
from asfm.datasets.images import scale_to_unit
from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError
from asfm.geometry.poses import make_pose
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, Frame, ImageArray, Trajectory

ROTATION_TOLERANCE = 1e-3
"""Poses are float32, good to 1e-6; more than this is no rotation."""


@dataclass(frozen=True)
class PickledFrames:
    """Where the images of one recording lie."""

    timestamps_s: FloatArray
    paths: tuple[Path, ...]
    sonar_name: str
    shape: tuple[int, int]


@dataclass(frozen=True)
class _Tick:
    """What one pass over the pickles keeps of each."""

    path: Path
    shape: tuple[int, int]
    time_s: float | None
    world_from_sonar: FloatArray | None


def is_holoocean(path: Path) -> bool:
    """Tell whether a folder, or the one above it, holds Config.json and pickles."""
    return _find_folders(path) is not None


def read_holoocean(path: Path) -> Sequence:
    """Open a folder of pickles; each is read once for its pose and time, its image again when asked for.

    The PoseSensor's poses become the ground truth and the vehicle's frame is the sonar's. Stamps are the recorded
    times where all pickles have them and they rise, else the frame's number over the sonar's rate.

    Raises:
        AsfmError: Config.json or a pickle is missing, damaged or does not fit the others; the message names it.
    """
    folders = _find_folders(path)
    if folders is None:
        raise AsfmError(f"{path}: expected Config.json and pickles (*.pkl) in it or in Data, found none")
    root, data = folders
    scenario = read_scenario(root / "Config.json")
    diagnostics: list[Diagnostic] = []
    ticks = _read_ticks(data, scenario, diagnostics)
    shape = ticks[0].shape
    scenario.check_shape(shape, ticks[0].path)
    timestamps_s = _choose_timestamps(ticks, scenario, diagnostics)
    frames = PickledFrames(timestamps_s, tuple(tick.path for tick in ticks), scenario.sonar_name, shape)
    sonar = SonarModel.evenly_spaced(
        name=f"HoloOcean {scenario.sonar_name}",
        range_m=scenario.range_m,
        bearing_rad=(-scenario.azimuth_rad / 2, scenario.azimuth_rad / 2),
        shape=shape,
        elevation_aperture_rad=scenario.elevation_rad,
    )
    return Sequence(
        name=root.resolve().name,
        sonar=sonar,
        timestamps_s=timestamps_s,
        read_frame=partial(read_pickled_frame, frames),
        groundtruth=_gather_groundtruth(ticks, timestamps_s, scenario, diagnostics),
        kind="holoocean",
        diagnostics=tuple(diagnostics),
    )


def read_pickled_frame(frames: PickledFrames, index: int) -> Frame:
    """Read one image; what is not finite becomes 0 and invalid, the rest is clipped to 0..1."""
    if not 0 <= index < len(frames.paths):
        raise IndexError(f"frame {index} of a sequence with frames 0..{len(frames.paths) - 1}")
    path = frames.paths[index]
    pixels = _pick_image(path, _load_state(path), frames.sonar_name)
    if pixels.shape != frames.shape:
        raise AsfmError(
            f"{path}: expected {frames.sonar_name} of shape {frames.shape} (ranges, beams) as in the first pickle, "
            f"found {pixels.shape}"
        )
    return Frame(index, float(frames.timestamps_s[index]), *_unit_image(pixels))


def _find_folders(path: Path) -> tuple[Path, Path] | None:
    """Find the folder of Config.json and the folder of the pickles."""
    for root, data in ((path, path / "Data"), (path, path), (path.resolve().parent, path)):
        if (root / "Config.json").is_file() and data.is_dir() and next(data.glob("*.pkl"), None) is not None:
            return root, data
    return None


def _read_ticks(data: Path, scenario: Scenario, diagnostics: list[Diagnostic]) -> list[_Tick]:
    paths = sorted(data.glob("*.pkl"), key=_number_in_name)
    ticks = []
    for path in paths:
        state = _load_state(path)
        if scenario.sonar_name not in state:
            continue
        shape = _pick_image(path, state, scenario.sonar_name).shape
        time_s = None if "t" not in state else _pick_time(path, state["t"])
        pose = _pick_pose(path, state[scenario.pose_name], scenario.scale) if scenario.pose_name in state else None
        ticks.append(_Tick(path, (shape[0], shape[1]), time_s, pose))
    if not ticks:
        raise AsfmError(f"{data}: expected {scenario.sonar_name} in the pickles, found it in none of {len(paths)}")
    if len(ticks) < len(paths):
        message = f"{len(paths) - len(ticks)} of {len(paths)} pickles hold no {scenario.sonar_name} and are left out"
        diagnostics.append(Diagnostic("incomplete-records", message))
    return ticks


def _number_in_name(path: Path) -> tuple[int, str]:
    """Sort 2.pkl before 10.pkl: the numbers are not always padded."""
    numbers = re.findall(r"\d+", path.stem)
    return int(numbers[-1]) if numbers else -1, path.name


def _load_state(path: Path) -> dict[Any, Any]:
    state = load_pickle(path)
    if not isinstance(state, dict):
        raise AsfmError(f"{path}: expected a dict of sensors, found {type(state).__name__}")
    return state


def _pick_image(path: Path, state: dict[Any, Any], name: str) -> Any:
    pixels = np.asarray(state.get(name))
    is_number = np.issubdtype(pixels.dtype, np.floating) or pixels.dtype == np.uint8
    if pixels.ndim != 2 or min(pixels.shape) < 2 or not is_number:
        raise AsfmError(
            f"{path}: expected {name} as (ranges, beams) of floats or uint8, "
            f"found shape {pixels.shape} of {pixels.dtype}"
        )
    return pixels


def _pick_time(path: Path, value: Any) -> float:
    time_s = np.asarray(value)
    if time_s.size != 1 or time_s.dtype.kind not in "iuf" or not np.isfinite(time_s).all():
        raise AsfmError(f"{path}: expected one finite number of seconds as t, found {str(value)[:60]!r}")
    return float(time_s.item())


def _pick_pose(path: Path, value: Any, scale: float) -> FloatArray:
    pose = np.asarray(value)
    if pose.shape != (4, 4) or pose.dtype.kind not in "iuf" or not np.isfinite(pose).all():
        raise AsfmError(f"{path}: expected a finite 4 x 4 pose, found {' '.join(str(pose).split())[:80]}")
    rotation = pose[:3, :3].astype(np.float64)
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
        raise AsfmError(f"{path}: expected a rotation in the pose, found {' '.join(str(rotation).split())[:120]}")
    return make_pose(pose[:3, 3].astype(np.float64) / scale, Rotation.from_matrix(rotation))


def _choose_timestamps(ticks: list[_Tick], scenario: Scenario, diagnostics: list[Diagnostic]) -> FloatArray:
    nominal_s = np.arange(len(ticks)) / scenario.rate_hz
    times_s = [tick.time_s for tick in ticks if tick.time_s is not None]
    if not times_s:
        return nominal_s
    if len(times_s) == len(ticks) and np.all(np.diff(times_s) > 0):
        return np.array(times_s)
    reason = "do not rise" if len(times_s) == len(ticks) else f"are missing from {len(ticks) - len(times_s)} pickles"
    message = f"the recorded times {reason}: frames are stamped at the sonar's nominal {scenario.rate_hz:g} Hz"
    diagnostics.append(Diagnostic("unreliable-stamps", message))
    return nominal_s


def _gather_groundtruth(
    ticks: list[_Tick], timestamps_s: FloatArray, scenario: Scenario, diagnostics: list[Diagnostic]
) -> Trajectory | None:
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


def _unit_image(pixels: Any) -> tuple[ImageArray, BoolArray]:
    if pixels.dtype == np.uint8:
        return scale_to_unit(pixels), np.zeros(pixels.shape, dtype=bool)
    invalid = ~np.isfinite(pixels)
    image = np.where(invalid, 0, pixels).astype(np.float32)
    return np.clip(image, 0.0, 1.0), invalid
