"""Paths of the sonar: where it looks, from what distance, and how it sways meanwhile."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from asfm.errors import AsfmError
from asfm.poses import make_pose
from asfm.types import FloatArray


@dataclass(frozen=True)
class View:
    """How a scene wants to be looked at."""

    target_m: tuple[float, float, float]
    """World point in the middle of what is worth seeing."""
    heading_rad: float
    """Yaw of a sonar that looks at the target."""
    depression_rad: float
    """Angle by which the sonar looks down."""
    distance_m: float
    """From sonar to target."""


def place_sonar(
    target_m: FloatArray, heading_rad: FloatArray, depression_rad: FloatArray, distance_m: FloatArray
) -> FloatArray:
    """Give the level poses that look at (N, 3) targets; angles and distances are (N,). Returns (N, 4, 4)."""
    from scipy.spatial.transform import Rotation

    angles = np.stack(np.broadcast_arrays(heading_rad, depression_rad), axis=-1)
    rotation = Rotation.from_euler("ZY", angles)
    forward = rotation.as_matrix()[..., 0]
    return make_pose(target_m - distance_m[:, None] * forward, rotation)


def make_sway(times_s: FloatArray, amplitude: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Sway smoothly in six degrees of freedom about the identity.

    Args:
        times_s: (N,).
        amplitude: (6,) x y z in metres, roll pitch yaw in radians.
        rng: draws the periods (9 to 22 s) and phases.

    Returns:
        (N, 4, 4) sonar_level_from_sonar.
    """
    from scipy.spatial.transform import Rotation

    period_s = rng.uniform([14, 5], [22, 9], (6, 2))
    phase = rng.uniform(0, 2 * np.pi, (6, 2))
    waves = np.sin(2 * np.pi * times_s[:, None, None] / period_s + phase) @ np.array([0.85, 0.15])
    swing = waves * amplitude
    return make_pose(swing[:, :3], Rotation.from_euler("ZYX", swing[:, :2:-1]))


def _sway_amplitude(view: View, size: float = 1.0) -> FloatArray:
    """Sway in proportion to the distance, so that a near sonar keeps its target in view too."""
    metres = np.array([0.06, 0.22, 0.08]) * view.distance_m
    return size * np.concatenate([metres, np.deg2rad([11.0, 4.0, 9.0])])


def _hold(view: View, times_s: FloatArray) -> FloatArray:
    count = len(times_s)
    target_m = np.tile(np.array(view.target_m), (count, 1))
    full = np.ones(count)
    return place_sonar(target_m, full * view.heading_rad, full * view.depression_rad, full * view.distance_m)


def sway(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Hover over the target, swaying widely in all six axes, and creep forward by 0.12 m/s."""
    poses = _hold(view, times_s)
    forward = np.array([np.cos(view.heading_rad), np.sin(view.heading_rad), 0.0])
    poses[:, :3, 3] += 0.12 * (times_s - times_s.mean())[:, None] * forward
    return poses @ make_sway(times_s, _sway_amplitude(view), rng)


def hover(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Hold the place, swaying a little in all six axes."""
    return _hold(view, times_s) @ make_sway(times_s, _sway_amplitude(view, 0.3), rng)


def transect(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Pass along the scene sideways, to port, by 0.2 m/s, swaying in all six axes."""
    poses = _hold(view, times_s)
    port = np.array([-np.sin(view.heading_rad), np.cos(view.heading_rad), 0.0])
    poses[:, :3, 3] += 0.2 * (times_s - times_s.mean())[:, None] * port
    return poses @ make_sway(times_s, _sway_amplitude(view, 0.7), rng)


Motion = Callable[[View, FloatArray, np.random.Generator], FloatArray]
"""(view, (N,) stamps, generator) -> (N, 4, 4) world_from_sonar."""

MOTIONS: dict[str, Motion] = {"sway": sway, "hover": hover, "transect": transect}


def find_motion(name: str) -> Motion:
    """Give a motion by name.

    Raises:
        AsfmError: no such motion; the message lists those there are.
    """
    if name not in MOTIONS:
        raise AsfmError(f"unknown motion {name!r}; known: {', '.join(MOTIONS)}")
    return MOTIONS[name]
