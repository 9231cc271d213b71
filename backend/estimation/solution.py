"""Solution of one estimation round: triangulated tracks without outliers, and adjusted poses and points."""

from dataclasses import dataclass

import numpy as np

from asfm.backend.estimation.observation_selection import cap_observations
from asfm.backend.estimation.pose_errors import remove_pose_errors
from asfm.backend.estimation.residual_gate import make_residual_gate
from asfm.backend.estimation.track_noise import MAX_LAG, autocorrelation_inflation, estimate_track_noise
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
    """Poses and points estimated from tracks and sensors."""

    tracks: Tracks
    observed: BoolArray
    """(O,) which observations were used; the others are outliers of their track, or beyond the number kept of it."""
    bundle: Bundle
    problem: BundleProblem
    """Input of the bundle adjustment."""
    elevation_information_ratio: FloatArray
    """(T,) information of each track's observations about its elevation, over that in the graph."""


def solve_tracks(
    tracks: Tracks,
    sequence: Sequence,
    world_from_vehicle: FloatArray,
    sensors: SensorConstraints,
    config: Config,
    adjusted: bool = True,
) -> Solution:
    """Triangulate the tracks, reject outliers, estimate the noise, and adjust poses and points.

    Args:
        tracks: observations of landmarks.
        sequence: gives the sonar and its lever arm.
        world_from_vehicle: (N, 4, 4) initial poses.
        sensors: constraints on the poses from other sensors.
        config: sections ``tracks``, ``noise`` and ``backend``.
        adjusted: whether the initial poses come from an earlier adjustment.
    """
    sigma = observation_sigma(tracks, sequence.sonar, config.noise)
    gate = make_residual_gate(tracks, sequence, sensors, config)
    world_from_sonar = world_from_vehicle @ sequence.vehicle_from_sonar
    found = triangulate_tracks(tracks, world_from_sonar, sequence.sonar, gate.sigma, gate.gate)
    observed = _select_observations(tracks, found.inlier, sigma, config)
    views = np.bincount(tracks.track, observed, minlength=tracks.count)
    residual, autocorrelated = found.residual, sensors.measured and adjusted
    if autocorrelated:
        residual = remove_pose_errors(tracks, observed, residual, gate.sigma, found.xyz_m, world_from_sonar)
    noise = _estimate_noise(tracks.track, observed, residual, autocorrelated)
    inflation = np.sqrt(correlated_variance(views, config.backend.track_correlation))
    problem = BundleProblem(
        tracks=tracks,
        observed=observed,
        sigma=sigma * noise * inflation[tracks.track][:, None],
        sensors=sensors,
        vehicle_from_sonar=sequence.vehicle_from_sonar,
        half_aperture_rad=gate.gate.half_aperture_rad,
    )
    bundle = adjust_bundle(problem, world_from_vehicle, found.xyz_m)
    return Solution(tracks, observed, bundle, problem, _elevation_information_ratio(views, config))


def _select_observations(tracks: Tracks, inlier: BoolArray, sigma: FloatArray, config: Config) -> BoolArray:
    """Return which (O,) of the inliers are used: those of tracks with enough views, at most a given number of each."""
    views = np.bincount(tracks.track, inlier, minlength=tracks.count)
    observed = inlier & (views >= config.tracks.min_views)[tracks.track]
    return cap_observations(tracks, observed, sigma, config.backend.max_views)


def _estimate_noise(track: IntArray, observed: BoolArray, residual: FloatArray, autocorrelated: bool) -> FloatArray:
    """Estimate the (O, 2) factors of the sigmas of range and bearing from the (O, 2) residuals.

    Autocorrelation is estimated only after poses with measured motion were adjusted. Otherwise pose errors are larger
    than a linear fit can remove from the residuals, and would be taken for autocorrelated errors of the features.
    """
    noise = estimate_track_noise(track, observed, residual, MAX_LAG if autocorrelated else 0)
    inflation = autocorrelation_inflation(track, observed, residual) if autocorrelated else np.ones(2)
    return noise[track][:, None] * inflation


def _elevation_information_ratio(views: IntArray, config: Config) -> FloatArray:
    """Return the (T,) variances in the graph over those that apply to the elevation."""
    stated, elevation = config.backend.track_correlation, config.backend.elevation_correlation
    return correlated_variance(views, stated) / correlated_variance(views, min(elevation, stated))


def correlated_variance(views: IntArray, correlation: float) -> FloatArray:
    """Return the variance inflation of n observations whose errors are equally correlated by rho: 1 + (n - 1) rho.

    The mean of n values so correlated has the same variance as the mean of n independent values so inflated.

    Args:
        views: (T,) number n of observations of each track.
        correlation: rho, 0 to 1.

    Returns:
        (T,) factors of the variance.
    """
    return np.asarray(1 + correlation * np.maximum(views - 1, 0))
