"""Tracks of points on a rough floor whose truth is known, without images, for ``benchmark.py``."""

from dataclasses import dataclass

import numpy as np

from asfm.config import NoiseConfig
from asfm.geometry.feature_noise import feature_sigma
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.sequence import Sequence
from asfm.simulation.simulate import SENSOR_NOISE
from asfm.simulation.vehicle.sensors import SlowDrift, simulate_navigation, simulate_odometry
from asfm.simulation.vehicle.trajectories import View, find_motion
from asfm.types import BoolArray, FloatArray, Frame, IntArray, Tracks, Trajectory

SONAR = SonarModel.evenly_spaced(
    "rough floor", (0.5, 8.0), (-np.deg2rad(35), np.deg2rad(35)), (600, 256), float(np.deg2rad(12))
)
VIEW = View((0.0, 0.0, 0.0), 0.0, float(np.deg2rad(25)), 4.8)
"""Looks down on the floor at z = 0 from 2 m above."""
ROUGHNESS_M = 0.15
"""Standard deviation of the floor's height."""
SPARE = 4
"""So many times more points are drawn than may be needed: the sway takes some out of sight too soon."""


@dataclass(frozen=True)
class Floor:
    """A sequence that knows its truth but has no images, and what it sees."""

    sequence: Sequence
    tracks: Tracks
    xyz_m: FloatArray
    """(T, 3) the true points."""


def make_floor(
    frames: int, observations: int, views: tuple[int, int], motion: str, rate_hz: float, navigation: bool, seed: int = 0
) -> Floor:
    """Make tracks of points on a rough floor: features good to 1.5 rows and a beam, odometry that drifts.

    Args:
        frames: how many.
        observations: of each frame, in the mean.
        views: fewest and most frames of a track, in succession.
        motion: name of a motion.
        rate_hz: of the frames.
        navigation: whether depth and attitude are measured besides.
        seed: of everything drawn by chance.
    """
    rng = np.random.default_rng(seed)
    stamps_s = np.arange(frames) / rate_hz
    path = Trajectory(stamps_s, find_motion(motion)(VIEW, stamps_s, rng))
    sequence = Sequence(
        name="rough floor",
        sonar=SONAR,
        timestamps_s=stamps_s,
        read_frame=_no_frame,
        odometry=simulate_odometry(path, SENSOR_NOISE, rng, SlowDrift()),
        navigation=simulate_navigation(path, SENSOR_NOISE, rng) if navigation else None,
        groundtruth=path,
        noise=SENSOR_NOISE,
    )
    xyz_m, track, frame = _see_points(path.world_from_vehicle, frames * observations, views, rng)
    seen = transform(invert(path.world_from_vehicle)[frame], xyz_m[track])
    sigma = np.tile(feature_sigma(SONAR, NoiseConfig()), (len(track), 1))
    place = np.stack(project(seen)[:2], axis=1) + sigma * rng.standard_normal((len(track), 2))
    return Floor(sequence, Tracks(track, frame, place[:, 0], place[:, 1], sigma), xyz_m)


def _see_points(
    world_from_sonar: FloatArray, wanted: int, views: tuple[int, int], rng: np.random.Generator
) -> tuple[FloatArray, IntArray, IntArray]:
    """Draw points on the floor until they are seen often enough: (T, 3) points, (O,) tracks and (O,) frames."""
    count = SPARE * max(wanted // views[0], 1)
    length = rng.integers(views[0], views[1] + 1, count)
    first = rng.integers(1 - views[0], len(world_from_sonar), count)
    middle = np.clip(first + length // 2, 0, len(world_from_sonar) - 1)
    xyz_m, hits = _hit_floor(world_from_sonar[middle], rng)
    frame = first[:, None] + np.arange(views[1])
    seen = (np.arange(views[1]) < length[:, None]) & (frame >= 0) & (frame < len(world_from_sonar))
    poses = invert(world_from_sonar)[np.clip(frame, 0, len(world_from_sonar) - 1)]
    seen &= SONAR.sees(transform(poses, xyz_m[:, None])) & hits[:, None]
    often = np.flatnonzero(seen.sum(axis=1) >= views[0])
    kept = often[: int(np.searchsorted(np.cumsum(seen[often].sum(axis=1)), wanted)) + 1]
    track, step = np.nonzero(seen[kept])
    return xyz_m[kept], track, frame[kept][track, step]


def _hit_floor(world_from_sonar: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, BoolArray]:
    """Follow a ray at random inside each sonar's frustum to the floor: (T, 3) points, and whether it lies in range."""
    count, half_rad = len(world_from_sonar), SONAR.elevation_aperture_rad / 2
    bearing_rad = rng.uniform(SONAR.bearing_edges_rad[0], SONAR.bearing_edges_rad[-1], count)
    ray = back_project(np.ones(count), bearing_rad, rng.uniform(-half_rad, half_rad, count))
    ray = np.einsum("nij,nj->ni", world_from_sonar[:, :3, :3], ray)
    height_m = ROUGHNESS_M * rng.standard_normal(count)
    down = np.minimum(ray[:, 2], -1e-6)
    range_m = (height_m - world_from_sonar[:, 2, 3]) / down
    hits = (range_m > SONAR.range_edges_m[0]) & (range_m < SONAR.range_edges_m[-1])
    return world_from_sonar[:, :3, 3] + range_m[:, None] * ray, hits


def _no_frame(index: int) -> Frame:
    raise AssertionError(f"there are no images, frame {index} was asked for")
