"""Simulated tracks without images: noisy observations of points on a rough floor, with ground truth."""

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
"""Looks down on the floor at z = 0 from a height of 2 m."""
ROUGHNESS_M = 0.15
"""Standard deviation of the height of the floor."""
OVERSAMPLING = 4
"""Ratio of points drawn to points needed: the sway takes some out of view after too few frames."""


@dataclass(frozen=True)
class TrackSimulation:
    """A sequence with ground truth but without images, and the tracks observed in it."""

    sequence: Sequence
    tracks: Tracks
    xyz_m: FloatArray
    """(T, 3) true points in the world frame."""


def simulate_tracks(
    frames: int, observations: int, views: tuple[int, int], motion: str, rate_hz: float, navigation: bool, seed: int = 0
) -> TrackSimulation:
    """Simulate tracks of points on a rough floor, and odometry with drift.

    The observation noise is that of :class:`asfm.config.NoiseConfig`.

    Args:
        frames: number of frames.
        observations: mean number of observations per frame.
        views: smallest and largest length of a track in consecutive frames.
        motion: key of :data:`asfm.simulation.vehicle.trajectories.MOTIONS`.
        rate_hz: frame rate.
        navigation: whether depth and attitude are measured.
        seed: seed of all random numbers.
    """
    rng = np.random.default_rng(seed)
    timestamps_s = np.arange(frames) / rate_hz
    path = Trajectory(timestamps_s, find_motion(motion)(VIEW, timestamps_s, rng))
    sequence = Sequence(
        name="rough floor",
        sonar=SONAR,
        timestamps_s=timestamps_s,
        read_frame=_refuse_frame,
        odometry=simulate_odometry(path, SENSOR_NOISE, rng, SlowDrift()),
        navigation=simulate_navigation(path, SENSOR_NOISE, rng) if navigation else None,
        groundtruth=path,
        noise=SENSOR_NOISE,
    )
    xyz_m, track, frame = _draw_tracks(path.world_from_vehicle, frames * observations, views, rng)
    in_sonar_m = transform(invert(path.world_from_vehicle)[frame], xyz_m[track])
    sigma = np.tile(feature_sigma(SONAR, NoiseConfig()), (len(track), 1))
    range_bearing = np.stack(project(in_sonar_m)[:2], axis=1) + sigma * rng.standard_normal((len(track), 2))
    return TrackSimulation(sequence, Tracks(track, frame, range_bearing[:, 0], range_bearing[:, 1], sigma), xyz_m)


def _draw_tracks(
    world_from_sonar: FloatArray, wanted: int, views: tuple[int, int], rng: np.random.Generator
) -> tuple[FloatArray, IntArray, IntArray]:
    """Draw points until ``wanted`` observations are reached: (T, 3) points, (O,) tracks and (O,) frames."""
    count = OVERSAMPLING * max(wanted // views[0], 1)
    length = rng.integers(views[0], views[1] + 1, count)
    first = rng.integers(1 - views[0], len(world_from_sonar), count)
    middle = np.clip(first + length // 2, 0, len(world_from_sonar) - 1)
    xyz_m, hits = _hit_floor(world_from_sonar[middle], rng)
    frame = first[:, None] + np.arange(views[1])
    visible = (np.arange(views[1]) < length[:, None]) & (frame >= 0) & (frame < len(world_from_sonar))
    poses = invert(world_from_sonar)[np.clip(frame, 0, len(world_from_sonar) - 1)]
    visible &= SONAR.sees(transform(poses, xyz_m[:, None])) & hits[:, None]
    long_enough = np.flatnonzero(visible.sum(axis=1) >= views[0])
    kept = long_enough[: int(np.searchsorted(np.cumsum(visible[long_enough].sum(axis=1)), wanted)) + 1]
    track, step = np.nonzero(visible[kept])
    return xyz_m[kept], track, frame[kept][track, step]


def _hit_floor(world_from_sonar: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, BoolArray]:
    """Cast one random ray inside the frustum of each (T, 4, 4) pose: (T, 3) floor points, (T,) whether in range."""
    count, half_rad = len(world_from_sonar), SONAR.elevation_aperture_rad / 2
    bearing_rad = rng.uniform(SONAR.bearing_edges_rad[0], SONAR.bearing_edges_rad[-1], count)
    ray = back_project(np.ones(count), bearing_rad, rng.uniform(-half_rad, half_rad, count))
    ray = np.einsum("nij,nj->ni", world_from_sonar[:, :3, :3], ray)
    height_m = ROUGHNESS_M * rng.standard_normal(count)
    down = np.minimum(ray[:, 2], -1e-6)
    range_m = (height_m - world_from_sonar[:, 2, 3]) / down
    hits = (range_m > SONAR.range_edges_m[0]) & (range_m < SONAR.range_edges_m[-1])
    return world_from_sonar[:, :3, 3] + range_m[:, None] * ray, hits


def _refuse_frame(index: int) -> Frame:
    raise AssertionError(f"simulated tracks have no images, found a request for frame {index}")
