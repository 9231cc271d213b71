"""Paths of the sonar: where it looks, from what distance, and how it sways meanwhile."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from asfm.errors import AsfmError
from asfm.geometry.poses import make_pose
from asfm.types import FloatArray

SPEED_M_S = 0.2
"""A careful inspection vehicle."""


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

    @property
    def forward(self) -> FloatArray:
        """(3,) horizontal unit vector ahead."""
        return np.array([np.cos(self.heading_rad), np.sin(self.heading_rad), 0.0])

    @property
    def port(self) -> FloatArray:
        """(3,) horizontal unit vector to the left."""
        return np.array([-np.sin(self.heading_rad), np.cos(self.heading_rad), 0.0])


def look_at(view: View, target_m: FloatArray, heading_rad: FloatArray | float) -> FloatArray:
    """Give the level poses that look at (N, 3) targets with the view's depression and distance. (N, 4, 4)."""
    from scipy.spatial.transform import Rotation

    heading_rad = np.broadcast_to(heading_rad, len(target_m))
    rotation = Rotation.from_euler("ZY", np.stack([heading_rad, np.full(len(target_m), view.depression_rad)], axis=-1))
    return make_pose(target_m - view.distance_m * rotation.as_matrix()[..., 0], rotation)


def make_sway(view: View, times_s: FloatArray, size: float, rng: np.random.Generator) -> FloatArray:
    """Sway smoothly in six degrees of freedom about the identity.

    Size 1 is 22 % of the distance sideways, 11 degrees of roll, 4 of pitch, 9 of yaw, with periods of 14 to 22 s and a
    smaller part of 5 to 9 s; in proportion to the distance, so that a near sonar keeps its target in view too.

    Returns:
        (N, 4, 4) level_from_sonar.
    """
    from scipy.spatial.transform import Rotation

    metres = np.array([0.06, 0.22, 0.08]) * view.distance_m
    amplitude = size * np.concatenate([metres, np.deg2rad([11.0, 4.0, 9.0])])
    period_s = rng.uniform([14, 5], [22, 9], (6, 2))
    phase = rng.uniform(0, 2 * np.pi, (6, 2))
    waves = np.sin(2 * np.pi * times_s[:, None, None] / period_s + phase) @ np.array([0.85, 0.15])
    swing = waves * amplitude
    return make_pose(swing[:, :3], Rotation.from_euler("ZYX", swing[:, :2:-1]))


def _slide(view: View, forward_m: FloatArray, port_m: FloatArray) -> FloatArray:
    """(N, 3) targets that slide over the scene horizontally."""
    return np.array(view.target_m) + forward_m[:, None] * view.forward + port_m[:, None] * view.port


def sway(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Creep forward by 0.12 m/s, swaying widely in all six axes."""
    ahead_m = 0.12 * (times_s - times_s.mean())
    poses = look_at(view, _slide(view, ahead_m, 0 * ahead_m), view.heading_rad)
    return poses @ make_sway(view, times_s, 1.0, rng)


def hover(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Hold the place, swaying a little in all six axes."""
    return static(view, times_s, rng) @ make_sway(view, times_s, 0.3, rng)


def transect(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Pass along the scene sideways, to port, swaying in all six axes."""
    aside_m = SPEED_M_S * (times_s - times_s.mean())
    poses = look_at(view, _slide(view, 0 * aside_m, aside_m), view.heading_rad)
    return poses @ make_sway(view, times_s, 0.7, rng)


def lawnmower(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Pass sideways in lanes of 3 m, each 0.7 m ahead of the one before."""
    port_m, forward_m = _lanes(times_s, 3.0, 0.7)
    return look_at(view, _slide(view, forward_m, port_m), view.heading_rad) @ make_sway(view, times_s, 0.4, rng)


def hull_sweep(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Pass ahead and back in lanes of 2 m, each 0.7 m to port of the one before, as an inspection of plating does."""
    forward_m, port_m = _lanes(times_s, 2.0, 0.7)
    return look_at(view, _slide(view, forward_m, port_m), view.heading_rad) @ make_sway(view, times_s, 0.4, rng)


def _lanes(times_s: FloatArray, length_m: float, step_m: float) -> tuple[FloatArray, FloatArray]:
    """Run lanes there and back with steps between them, corners rounded: (N,) along the lanes and (N,) across."""
    run_m = SPEED_M_S * (times_s - times_s[0])
    lap_m = length_m + step_m
    # Averages over a stretch of the path round the corners without leaving it by more than half the stretch.
    smooth = run_m[:, None] + np.linspace(-0.25, 0.25, 41)
    lap, into_m = np.divmod(np.maximum(smooth, 0), lap_m)
    share = np.minimum(into_m, length_m) / length_m
    along_m = length_m * (np.where(lap % 2 == 0, share, 1 - share) - 0.5)
    across_m = lap * step_m + np.maximum(into_m - length_m, 0)
    return along_m.mean(axis=1), across_m.mean(axis=1)


def orbit(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Circle the target, looking at it."""
    heading_rad = view.heading_rad + SPEED_M_S / view.distance_m * (times_s - times_s[0])
    still = np.zeros(len(times_s))
    return look_at(view, _slide(view, still, still), heading_rad) @ make_sway(view, times_s, 0.3, rng)


def revisit(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Go once round a loop over the scene and an eighth of it again, whatever the number of frames: a loop to close."""
    duration_s = max(times_s[-1] - times_s[0], 1e-9)
    turn = 2 * np.pi * 1.125 * (times_s - times_s[0]) / duration_s
    radius_m = SPEED_M_S * duration_s / (2 * np.pi * 1.125)
    target_m = _slide(view, radius_m * (np.cos(turn) - 1), radius_m * np.sin(turn))
    return look_at(view, target_m, view.heading_rad) @ make_sway(view, times_s, 0.3, rng)


def planar(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Move in x, y and yaw only: height, roll and pitch stay, so that elevation is not observable from a flat scene."""
    swing = make_sway(view, times_s, 0.7, rng)[:, :3, 3]
    yaw_rad = np.deg2rad(8.0) * np.sin(2 * np.pi * times_s / rng.uniform(12, 20) + rng.uniform(0, 2 * np.pi))
    ahead_m = 0.12 * (times_s - times_s.mean())
    return look_at(view, _slide(view, swing[:, 0] + ahead_m, swing[:, 1]), view.heading_rad + yaw_rad)


def static(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:  # noqa: ARG001 - a motion's signature
    """Stand still: nothing can be triangulated."""
    still = np.zeros(len(times_s))
    return look_at(view, _slide(view, still, still), view.heading_rad)


Motion = Callable[[View, FloatArray, np.random.Generator], FloatArray]
"""(view, (N,) stamps, generator) -> (N, 4, 4) world_from_sonar."""

MOTIONS: dict[str, Motion] = {
    "sway": sway,
    "hover": hover,
    "transect": transect,
    "lawnmower": lawnmower,
    "hull_sweep": hull_sweep,
    "orbit": orbit,
    "revisit": revisit,
    "planar": planar,
    "static": static,
}


def find_motion(name: str) -> Motion:
    """Give a motion by name.

    Raises:
        AsfmError: no such motion; the message lists those there are.
    """
    if name not in MOTIONS:
        raise AsfmError(f"unknown motion {name!r}; known: {', '.join(MOTIONS)}, or a path in TUM format")
    return MOTIONS[name]
