"""Pickled ticks of HoloOcean recordings: image, pose and time of each, validated."""

import re
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from asfm.datasets.holoocean.config_json import Scenario
from asfm.datasets.holoocean.pixel_scale import Levels, measure_levels
from asfm.datasets.holoocean.safe_pickle import load_pickle
from asfm.datasets.tables import MAX_POSITION_M
from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError, quote, shorten
from asfm.geometry.poses import make_pose
from asfm.regular_file import check_inside
from asfm.types import FloatArray

ROTATION_TOLERANCE = 1e-3
"""Largest deviation of R R^T from the identity; poses are float32, exact to 1e-6."""


@dataclass(frozen=True)
class Tick:
    """One pickle without its pixels."""

    path: Path
    shape: tuple[int, int]
    """(ranges, beams)"""
    time_s: float | None
    world_from_sonar: FloatArray | None
    """(4, 4)"""
    levels: Levels | None = None
    """Values of the image's pixels; None where they are bytes."""


def read_ticks(data: Path, scenario: Scenario, diagnostics: list[Diagnostic]) -> list[Tick]:
    """Read the ticks of a recording in the order of the numbers in their file names.

    Args:
        data: the folder of the pickles.
        scenario: names of the sensors, and the scale of lengths.
        diagnostics: gets a diagnostic where pickles without a sonar image are left out.

    Returns:
        The ticks that hold a sonar image, at least one; poses are in metres, divided by the scenario's scale.

    Raises:
        AsfmError: a pickle cannot be read, its image, time or pose is invalid, or none holds a sonar image.
    """
    paths = sorted(data.glob("*.pkl"), key=_number_in_name)
    ticks = []
    for path in paths:
        if path.is_symlink():
            check_inside(data, path, "a pickle")
        state = load_state(path)
        if scenario.sonar_name not in state:
            continue
        pixels = read_image(path, state, scenario.sonar_name)
        time_s = None if "t" not in state else _read_time(path, state["t"])
        pose = _read_pose(path, state[scenario.pose_name], scenario.scale) if scenario.pose_name in state else None
        levels = None if pixels.dtype == np.uint8 else measure_levels(pixels)
        ticks.append(Tick(path, pixels.shape, time_s, pose, levels))
    if not ticks:
        raise AsfmError(f"{data}: expected {scenario.sonar_name} in the pickles, found it in none of {len(paths)}")
    if len(ticks) < len(paths):
        message = f"{len(paths) - len(ticks)} of {len(paths)} pickles hold no {scenario.sonar_name} and are left out"
        diagnostics.append(Diagnostic("incomplete-records", message))
    return ticks


def load_state(path: Path) -> dict[Any, Any]:
    """Load the readings of all sensors at one tick, by sensor name.

    Raises:
        AsfmError: the pickle cannot be read, or holds no dict.
    """
    state = load_pickle(path)
    if not isinstance(state, dict):
        raise AsfmError(f"{path}: expected a dict of sensors, found {type(state).__name__}")
    return state


def read_image(path: Path, state: dict[Any, Any], name: str) -> Any:
    """Return the image of a sonar, (ranges, beams) of floats or uint8, from the state of a tick.

    Raises:
        AsfmError: there is no such sensor, or its reading is no image.
    """
    pixels = _as_array(path, name, state.get(name))
    is_number = np.issubdtype(pixels.dtype, np.floating) or pixels.dtype == np.uint8
    if pixels.ndim != 2 or min(pixels.shape) < 2 or not is_number:
        raise AsfmError(
            f"{path}: expected {name} as (ranges, beams) of floats or uint8, "
            f"found shape {quote(pixels.shape)} of {shorten(str(pixels.dtype))}"
        )
    return pixels


def _as_array(path: Path, name: str, value: Any) -> Any:
    """Return a reading as an array; numbers in lists are accepted."""
    try:
        return np.asarray(value)
    except (ValueError, OverflowError, TypeError):
        raise AsfmError(f"{path}: expected {quote(name)[1:-1]} as an array, found lists of unequal lengths") from None


def _number_in_name(path: Path) -> tuple[Decimal, str]:
    """Return a sort key that puts 2.pkl before 10.pkl: the numbers are not always padded."""
    numbers = re.findall(r"\d+", path.stem)
    return Decimal(numbers[-1]) if numbers else Decimal(-1), path.name


def _read_time(path: Path, value: Any) -> float:
    time_s = _as_array(path, "t", value)
    if time_s.size != 1 or time_s.dtype.kind not in "iuf" or not np.isfinite(time_s).all():
        raise AsfmError(f"{path}: expected one finite number of seconds as t, found {quote(value)}")
    return float(time_s.item())


def _read_pose(path: Path, value: Any, scale: float) -> FloatArray:
    """Validate a pose (4, 4), and divide its translation by the scale of the scenario."""
    from scipy.spatial.transform import Rotation  # slow to load

    pose = _as_array(path, "a pose", value)
    if pose.shape != (4, 4) or pose.dtype.kind not in "iuf" or not (np.abs(pose) <= MAX_POSITION_M).all():
        raise AsfmError(f"{path}: expected a finite 4 x 4 pose, found {shorten(str(pose))}")
    rotation = pose[:3, :3].astype(np.float64)
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
        raise AsfmError(f"{path}: expected a rotation in the pose, found {shorten(str(rotation))}")
    return make_pose(pose[:3, 3].astype(np.float64) / scale, Rotation.from_matrix(rotation))
