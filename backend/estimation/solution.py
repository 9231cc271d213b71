"""One round of the back-end: triangulate the tracks, drop what disagrees, adjust poses and points."""

from dataclasses import dataclass

import numpy as np

from asfm.backend.estimation.observation_selection import cap_observations
from asfm.backend.estimation.pose_errors import remove_pose_errors
from asfm.backend.estimation.residual_gate import make_residual_gate
from asfm.backend.estimation.track_noise import LAGS, autocorrelation_inflation, estimate_track_noise
from asfm.backend.estimation.triangulation import triangulate_tracks
from asfm.backend.graph.bundle_adjustment import Bundle, adjust_bundle
from asfm.backend.graph.problem import BundleProblem
from asfm.config import Config
from asfm.geometry.feature_noise import observation_sigma
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, IntArray, Tracks


@dataclass(frozen=True)
class Solution:
    """Poses and points that agree with tracks and sensors."""

    tracks: Tracks
    observed: BoolArray
    """(O,) the observations that were used; the others contradicted their track's point."""
    bundle: Bundle
    problem: BundleProblem
    """What the bundle was the answer to."""
    elevation_information_ratio: FloatArray
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
    sigma = observation_sigma(tracks, sequence.sonar, config.noise)
    residual_gate = make_residual_gate(tracks, sequence, sensors, config)
    world_from_sonar = world_from_vehicle @ sequence.vehicle_from_sonar
    found = triangulate_tracks(tracks, world_from_sonar, sequence.sonar, residual_gate.sigma, residual_gate.gate)
    views = np.bincount(tracks.track, found.inlier, minlength=tracks.count)
    observed = found.inlier & (views >= config.tracks.min_views)[tracks.track]
    observed = cap_observations(tracks, observed, sigma, config.backend.max_views)
    views = np.bincount(tracks.track, observed, minlength=tracks.count)
    residual, told = found.residual, sensors.measured and adjusted
    if told:
        residual = remove_pose_errors(tracks, observed, residual, residual_gate.sigma, found.xyz_m, world_from_sonar)
    noise = _estimate_noise(tracks.track, observed, residual, told)
    in_common = np.sqrt(correlated_variance(views, config.backend.track_correlation))
    problem = BundleProblem(
        tracks=tracks,
        observed=observed,
        sigma=sigma * noise * in_common[tracks.track][:, None],
        sensors=sensors,
        vehicle_from_sonar=sequence.vehicle_from_sonar,
        half_aperture_rad=residual_gate.gate.half_aperture_rad,
    )
    bundle = adjust_bundle(problem, world_from_vehicle, found.xyz_m)
    return Solution(tracks, observed, bundle, problem, _elevation_information_ratio(views, config))


def _estimate_noise(track: IntArray, observed: BoolArray, residual: FloatArray, lasting: bool) -> FloatArray:
    """Estimate the (O, 2) factors of the sigmas of range and bearing that the residuals show.

    What lasts from frame to frame counts once poses of a measured motion have been adjusted. Before, and where the
    motion is guessed, poses err by more than a linear fit takes out of the residuals, and what lasts is their error.
    """
    noise = estimate_track_noise(track, observed, residual, LAGS if lasting else 0)
    return noise[track][:, None] * (autocorrelation_inflation(track, observed, residual) if lasting else np.ones(2))


def _elevation_information_ratio(views: IntArray, config: Config) -> FloatArray:
    """Compare (T,) variances: those of the graph with those that count for the elevation."""
    stated, elevation = config.backend.track_correlation, config.backend.elevation_correlation
    return correlated_variance(views, stated) / correlated_variance(views, min(elevation, stated))


def correlated_variance(views: IntArray, correlation: float) -> FloatArray:
    """Widen the variances of n observations whose errors are correlated by rho: 1 + (n - 1) rho.

    The mean of n values with that correlation is as uncertain as the mean of n independent ones so widened.
    """
    return np.asarray(1 + correlation * np.maximum(views - 1, 0))
