"""Trajectories of the sonar: motion patterns (transect, lawnmower, orbit, ...) with six-axis sway."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from asfm.errors import AsfmError, quote
from asfm.geometry.poses import make_pose
from asfm.types import FloatArray

SPEED_M_S = 0.2
"""Speed of a careful inspection vehicle."""


@dataclass(frozen=True)
class View:
    """Nominal viewpoint of a scene: target, heading, depression and distance."""

    target_m: tuple[float, float, float]
    """World point in the middle of the image."""
    heading_rad: float
    """Yaw of a sonar that looks at the target."""
    depression_rad: float
    """Angle by which the sonar looks down (tilt below the horizon)."""
    distance_m: float
    """From sonar to target."""

    @property
    def forward(self) -> FloatArray:
        """(3,) horizontal unit vector along the heading."""
        return np.array([np.cos(self.heading_rad), np.sin(self.heading_rad), 0.0])

    @property
    def port(self) -> FloatArray:
        """(3,) horizontal unit vector to the left."""
        return np.array([-np.sin(self.heading_rad), np.cos(self.heading_rad), 0.0])


def look_at(view: View, target_m: FloatArray, heading_rad: FloatArray | float) -> FloatArray:
    """Return the poses without roll that look at targets with the view's depression and distance.

    Args:
        view: depression and distance.
        target_m: (N, 3) world points.
        heading_rad: (N,) or one for all.

    Returns:
        (N, 4, 4) world_from_sonar.
    """
    from scipy.spatial.transform import Rotation

    heading_rad = np.broadcast_to(heading_rad, len(target_m))
    rotation = Rotation.from_euler("ZY", np.stack([heading_rad, np.full(len(target_m), view.depression_rad)], axis=-1))
    return make_pose(target_m - view.distance_m * rotation.as_matrix()[..., 0], rotation)


def make_sway(view: View, times_s: FloatArray, size: float, rng: np.random.Generator) -> FloatArray:
    """Make a smooth sway in six degrees of freedom about the identity.

    Translation is proportional to the view's distance, so that a sonar close to its target keeps it in view.

    Args:
        view: gives the distance.
        times_s: (N,)
        size: amplitude; 1 is 22 % of the distance sideways, 9 degrees of yaw, 4 of pitch and 11 of roll, with periods
            of 14 to 22 s and a smaller part of 5 to 9 s.
        rng: source of periods and phases.

    Returns:
        (N, 4, 4) level_from_sonar.
    """
    from scipy.spatial.transform import Rotation

    translation_m = np.array([0.06, 0.22, 0.08]) * view.distance_m
    amplitude = size * np.concatenate([translation_m, np.deg2rad([11.0, 4.0, 9.0])])
    period_s = rng.uniform([14, 5], [22, 9], (6, 2))
    phase = rng.uniform(0, 2 * np.pi, (6, 2))
    waves = np.sin(2 * np.pi * times_s[:, None, None] / period_s + phase) @ np.array([0.85, 0.15])
    offset = waves * amplitude
    return make_pose(offset[:, :3], Rotation.from_euler("ZYX", offset[:, :2:-1]))


def _move_target(view: View, forward_m: FloatArray, port_m: FloatArray) -> FloatArray:
    """Return the target moved horizontally by (N,) metres along the heading and to port: (N, 3)."""
    return np.array(view.target_m) + forward_m[:, None] * view.forward + port_m[:, None] * view.port


def sway(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Move forward at 0.12 m/s with a large sway in all six axes: (N, 4, 4) poses."""
    ahead_m = 0.12 * (times_s - times_s.mean())
    poses = look_at(view, _move_target(view, ahead_m, 0 * ahead_m), view.heading_rad)
    return poses @ make_sway(view, times_s, 1.0, rng)


def hover(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Keep station with a small sway in all six axes: (N, 4, 4) poses."""
    return static(view, times_s, rng) @ make_sway(view, times_s, 0.3, rng)


def transect(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Move sideways, to port, with a sway in all six axes: (N, 4, 4) poses."""
    aside_m = SPEED_M_S * (times_s - times_s.mean())
    poses = look_at(view, _move_target(view, 0 * aside_m, aside_m), view.heading_rad)
    return poses @ make_sway(view, times_s, 0.7, rng)


def lawnmower(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Move sideways in lanes of 3 m, each 0.7 m ahead of the one before (boustrophedon): (N, 4, 4) poses."""
    port_m, forward_m = _run_lanes(times_s, 3.0, 0.7)
    return look_at(view, _move_target(view, forward_m, port_m), view.heading_rad) @ make_sway(view, times_s, 0.4, rng)


def hull_sweep(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Move forward and back in lanes of 2 m, each 0.7 m to port, as in a hull inspection: (N, 4, 4) poses."""
    forward_m, port_m = _run_lanes(times_s, 2.0, 0.7)
    return look_at(view, _move_target(view, forward_m, port_m), view.heading_rad) @ make_sway(view, times_s, 0.4, rng)


def _run_lanes(times_s: FloatArray, length_m: float, step_m: float) -> tuple[FloatArray, FloatArray]:
    """Return the position in lanes run back and forth, corners rounded: (N,) metres along the lanes and across."""
    run_m = SPEED_M_S * (times_s - times_s[0])
    lap_m = length_m + step_m
    # Averaging over 0.5 m of the path rounds the corners.
    window_m = run_m[:, None] + np.linspace(-0.25, 0.25, 41)
    lap, into_m = np.divmod(np.maximum(window_m, 0), lap_m)
    share = np.minimum(into_m, length_m) / length_m
    along_m = length_m * (np.where(lap % 2 == 0, share, 1 - share) - 0.5)
    across_m = lap * step_m + np.maximum(into_m - length_m, 0)
    return along_m.mean(axis=1), across_m.mean(axis=1)


def orbit(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Circle around the target, facing it: (N, 4, 4) poses."""
    heading_rad = view.heading_rad + SPEED_M_S / view.distance_m * (times_s - times_s[0])
    still = np.zeros(len(times_s))
    return look_at(view, _move_target(view, still, still), heading_rad) @ make_sway(view, times_s, 0.3, rng)


def revisit(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Go once round a circle and an eighth of it again, for loop closure: (N, 4, 4) poses."""
    duration_s = max(times_s[-1] - times_s[0], 1e-9)
    turn = 2 * np.pi * 1.125 * (times_s - times_s[0]) / duration_s
    radius_m = SPEED_M_S * duration_s / (2 * np.pi * 1.125)
    target_m = _move_target(view, radius_m * (np.cos(turn) - 1), radius_m * np.sin(turn))
    return look_at(view, target_m, view.heading_rad) @ make_sway(view, times_s, 0.3, rng)


def planar(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Move in x, y and yaw only, where elevation is hardly observable: (N, 4, 4) poses."""
    sway_m = make_sway(view, times_s, 0.7, rng)[:, :3, 3]
    yaw_rad = np.deg2rad(8.0) * np.sin(2 * np.pi * times_s / rng.uniform(12, 20) + rng.uniform(0, 2 * np.pi))
    ahead_m = 0.12 * (times_s - times_s.mean())
    return look_at(view, _move_target(view, sway_m[:, 0] + ahead_m, sway_m[:, 1]), view.heading_rad + yaw_rad)


def random_walk(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Move forward at 0.12 m/s and wander in all six axes, with roll and pitch of 10 degrees rms: (N, 4, 4) poses.

    Each axis is an independent Gaussian process with a correlation time of two to four seconds, so that no axis repeats
    itself and roll and pitch are as large as yaw.
    """
    from scipy.spatial.transform import Rotation

    size = np.concatenate([np.array([0.03, 0.08, 0.03]) * view.distance_m, np.deg2rad([10.0, 10.0, 10.0])])
    ahead_m = 0.12 * (times_s - times_s.mean())
    offset = np.stack([_gaussian_process(times_s, rng) for _ in size], axis=1) * size
    poses = look_at(view, _move_target(view, ahead_m, 0 * ahead_m), view.heading_rad)
    return poses @ make_pose(offset[:, :3], Rotation.from_euler("ZYX", offset[:, :2:-1]))


def _gaussian_process(times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draw (N,) values of unit variance with a squared-exponential correlation over two to four seconds."""
    correlation_s, density = rng.uniform(2.0, 4.0), 4
    margin_s = 4 * correlation_s
    knot_s = np.arange(-margin_s, times_s[-1] - times_s[0] + margin_s, correlation_s / density)
    weight = np.exp(-(((times_s - times_s[0])[:, None] - knot_s) ** 2) / correlation_s**2)
    return np.asarray(weight @ rng.normal(size=len(knot_s)) / np.sqrt(density * np.sqrt(np.pi / 2)))


def static(view: View, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:  # noqa: ARG001 (a Motion)
    """Stand still, where nothing can be triangulated: (N, 4, 4) poses."""
    still = np.zeros(len(times_s))
    return look_at(view, _move_target(view, still, still), view.heading_rad)


Motion = Callable[[View, FloatArray, np.random.Generator], FloatArray]
"""(view, (N,) times in seconds, generator) -> (N, 4, 4) world_from_sonar."""

MOTIONS: dict[str, Motion] = {
    "sway": sway,
    "hover": hover,
    "transect": transect,
    "lawnmower": lawnmower,
    "hull_sweep": hull_sweep,
    "orbit": orbit,
    "revisit": revisit,
    "planar": planar,
    "random_walk": random_walk,
    "static": static,
}


def find_motion(name: str) -> Motion:
    """Return a motion by its name.

    Raises:
        AsfmError: there is no such motion; the message lists the known ones.
    """
    if name not in MOTIONS:
        raise AsfmError(f"unknown motion {quote(name)}; known: {', '.join(MOTIONS)}, or a path in TUM format")
    return MOTIONS[name]
