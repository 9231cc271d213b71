"""One round of the back-end: triangulate the tracks, drop what disagrees, adjust poses and points."""

from dataclasses import dataclass

import numpy as np

from asfm.backend.beam import EDGE_RAD
from asfm.backend.bundle import Bundle, adjust_bundle
from asfm.backend.pose_errors import remove_pose_errors
from asfm.backend.problem import BundleProblem
from asfm.backend.selection import cap_observations
from asfm.backend.sensors import SensorConstraints
from asfm.backend.track_noise import LAGS, estimate_track_noise, measure_persistence
from asfm.backend.triangulation import Gate, triangulate_tracks
from asfm.config import Config
from asfm.sequence import Sequence
from asfm.sonar import feature_sigma
from asfm.types import BoolArray, FloatArray, IntArray, Tracks

MEASURED_SLACK, GUESSED_SLACK = 1.2, 1.5
"""Sigmas are widened by this for triangulation, because the poses are not yet right: measured and guessed motion."""


@dataclass(frozen=True)
class Solution:
    """Poses and points that agree with tracks and sensors."""

    tracks: Tracks
    observed: BoolArray
    """(O,) the observations that were used; the others contradicted their track's point."""
    bundle: Bundle
    problem: BundleProblem
    """What the bundle was the answer to."""
    relief: FloatArray
    """(T,) by how much more each track's observations tell of its elevation than the graph states."""


def solve_tracks(
    tracks: Tracks,
    sequence: Sequence,
    world_from_vehicle: FloatArray,
    sensors: SensorConstraints,
    config: Config,
    adjusted: bool = True,
) -> Solution:
    """Triangulate, drop the observations that disagree, and adjust the rest.

    Args:
        tracks: observations of landmarks.
        sequence: gives the sonar and its lever arm.
        world_from_vehicle: (N, 4, 4) poses to start from.
        sensors: what else is known of the poses.
        config: sections ``tracks``, ``noise`` and ``backend``.
        adjusted: the poses are those of an adjustment, not yet those of the odometry.
    """
    typical = np.tile(feature_sigma(sequence.sonar, config.noise), (len(tracks), 1))
    sigma = typical if tracks.sigma is None else tracks.sigma
    gate = Gate(
        half_aperture_rad=sequence.sonar.elevation_aperture_rad / 2,
        edge_rad=float(np.hypot(EDGE_RAD, sensors.typical_rotation_rad)),
    )
    wide = np.maximum(sigma, typical) * (MEASURED_SLACK if sensors.measured else GUESSED_SLACK)
    world_from_sonar = world_from_vehicle @ sequence.vehicle_from_sonar
    found = triangulate_tracks(tracks, world_from_sonar, sequence.sonar, wide, gate)
    views = np.bincount(tracks.track, found.agrees, minlength=tracks.count)
    observed = found.agrees & (views >= config.tracks.min_views)[tracks.track]
    observed = cap_observations(tracks, observed, sigma, config.backend.max_views)
    views = np.bincount(tracks.track, observed, minlength=tracks.count)
    residual, told = found.residual, sensors.measured and adjusted
    if told:
        residual = remove_pose_errors(tracks, observed, residual, wide, found.xyz_m, world_from_sonar)
    noise = _estimate_noise(tracks.track, observed, residual, told)
    problem = BundleProblem(
        tracks=tracks,
        observed=observed,
        sigma=sigma * noise * _correlation_factor(views, config)[tracks.track][:, None],
        sensors=sensors,
        vehicle_from_sonar=sequence.vehicle_from_sonar,
        half_aperture_rad=gate.half_aperture_rad,
    )
    bundle = adjust_bundle(problem, world_from_vehicle, found.xyz_m)
    return Solution(tracks, observed, bundle, problem, _relieve(views, config))


def _estimate_noise(track: IntArray, observed: BoolArray, residual: FloatArray, lasting: bool) -> FloatArray:
    """Estimate the (O, 2) factors of the sigmas of range and bearing that the residuals show.

    What lasts from frame to frame counts once poses of a measured motion have been adjusted. Before, and where the
    motion is guessed, poses err by more than a linear fit takes out of the residuals, and what lasts is their error.
    """
    noise = estimate_track_noise(track, observed, residual, LAGS if lasting else 0)
    return noise[track][:, None] * (measure_persistence(track, observed, residual) if lasting else np.ones(2))


def _relieve(views: IntArray, config: Config) -> FloatArray:
    """Compare (T,) variances: those of the graph with those that count for the elevation."""
    others = np.maximum(views - 1, 0)
    stated, elevation = config.backend.track_correlation, config.backend.elevation_correlation
    return np.asarray((1 + stated * others) / (1 + min(elevation, stated) * others))


def _correlation_factor(views: IntArray, config: Config) -> FloatArray:
    """Widen the sigmas of a track's n observations whose errors are correlated by rho: sqrt(1 + (n - 1) rho).

    The mean of n values with that correlation is as uncertain as the mean of n independent ones so widened.
    """
    return np.asarray(np.sqrt(1 + config.backend.track_correlation * np.maximum(views - 1, 0)))
