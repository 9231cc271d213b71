"""Triangulation of tracks over an elevation grid with a truncated cost, for all tracks at once.

A sonar measures range and bearing, not elevation: the candidates for a track's point lie on elevation arcs.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from asfm.geometry.poses import angle_difference, invert, transform
from asfm.geometry.sonar import SonarModel, project, project_jacobian
from asfm.types import BoolArray, FloatArray, IntArray, Tracks

CHUNK_OBSERVATIONS = 20_000
"""Observations that the grid search treats at once, to bound memory."""
ELEVATION_PRIOR_SIGMAS = 0.3
"""Weak prior of a track's elevation at the middle of the beam: its residual, in sigmas, at the edge of the aperture."""
REFINEMENTS = 4
"""Gauss-Newton steps after the grid search."""
MAX_STEP_SHARE = 0.2
"""Longest Gauss-Newton step, over the mean range of the track."""


@dataclass(frozen=True)
class Gate:
    """Limits beyond which an observation is an outlier."""

    half_aperture_rad: float
    edge_rad: float
    """Standard deviation of the elevation beyond the edge of the aperture: beams do not end sharply, and the attitudes
    are not exact."""
    truncation: float = 3.0
    """Root of the largest squared residual of an inlier, in sigmas; also where the cost is truncated."""


@dataclass(frozen=True)
class Triangulation:
    """One point for each of T tracks, and the inliers among the O observations."""

    xyz_m: FloatArray
    """(T, 3) in the world frame."""
    inlier: BoolArray
    """(O,) the squared residual, distance from the aperture included, is within the truncation."""
    residual: FloatArray
    """(O, 2) whitened residuals of range and bearing."""


@dataclass(frozen=True)
class _Observations:
    """Observations of tracks with all that the search needs to compare points with them."""

    tracks: Tracks
    first: IntArray
    """(T,) index of each track's first observation."""
    world_from_sonar: FloatArray
    """(N, 4, 4) poses of the frames."""
    sonar_from_world: FloatArray
    """(O, 4, 4), one for each observation."""
    sigma: FloatArray
    """(O, 2) standard deviations of range_m and bearing_rad."""
    gate: Gate


def triangulate_tracks(
    tracks: Tracks,
    world_from_sonar: FloatArray,
    sonar: SonarModel,
    sigma: FloatArray,
    gate: Gate,
    elevation_count: int = 21,
) -> Triangulation:
    """Triangulate each track robustly under known poses.

    Candidates are the points of the elevation arcs (equation (2) with the elevation unknown) of the track's first,
    middle and last observation. The one with the least truncated squared cost is refined by Gauss-Newton steps over its
    inliers.

    Args:
        tracks: (O,) observations of T tracks, sorted by track.
        world_from_sonar: (N, 4, 4) poses of the frames.
        sonar: gives the elevation aperture.
        sigma: (O, 2) standard deviations of range_m and bearing_rad, pose errors included.
        gate: when an observation is an outlier; also bounds the elevation.
        elevation_count: points of the elevation grid.

    Returns:
        Points in the world frame.
    """
    count = tracks.count
    if count == 0:
        return Triangulation(np.zeros((0, 3)), np.zeros(0, dtype=bool), np.zeros((0, 2)))
    first = np.searchsorted(tracks.track, np.arange(count))
    sonar_from_world = invert(world_from_sonar)[tracks.frame]
    observations = _Observations(tracks, first, world_from_sonar, sonar_from_world, sigma, gate)
    xyz_m = np.empty((count, 3))
    for chunk in _chunks_of_tracks(first, len(tracks)):
        xyz_m[chunk] = _search_elevations(observations, chunk, sonar, elevation_count)
    for _ in range(REFINEMENTS):
        inlier, _ = _classify(xyz_m, observations)
        xyz_m = _refine(xyz_m, observations, inlier)
    inlier, residual = _classify(xyz_m, observations)
    return Triangulation(xyz_m, inlier, residual)


def whitened_residuals(
    xyz_m: FloatArray, tracks: Tracks, sonar_from_world: FloatArray, sigma: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compute the whitened residuals of the observations from their tracks' points.

    Args:
        xyz_m: (T, 3) points, world frame.
        tracks: (O,) observations.
        sonar_from_world: (O, 4, 4), one for each observation.
        sigma: (O, 2) standard deviations of range_m and bearing_rad.

    Returns:
        (O, 2) residuals of range and bearing in sigmas, (O,) elevation_rad of the point in the observing frame.
    """
    range_m, bearing_rad, elevation_rad = project(transform(sonar_from_world, xyz_m[tracks.track]))
    difference_rad = angle_difference(bearing_rad, tracks.bearing_rad)
    residual = np.stack([range_m - tracks.range_m, difference_rad], axis=-1) / sigma
    return residual, elevation_rad


def squared_residuals(
    xyz_m: FloatArray, tracks: Tracks, sonar_from_world: FloatArray, sigma: FloatArray, gate: Gate
) -> tuple[FloatArray, FloatArray]:
    """Compute the squared residual of each observation, including its point's distance from the elevation aperture.

    Args:
        xyz_m: (T, 3) points, world frame.
        tracks: (O,) observations.
        sonar_from_world: (O, 4, 4), one for each observation.
        sigma: (O, 2) standard deviations of range_m and bearing_rad.
        gate: elevation aperture and the blur of its edge.

    Returns:
        (O,) squared residuals, (O, 2) whitened residuals of range and bearing.
    """
    residual, elevation_rad = whitened_residuals(xyz_m, tracks, sonar_from_world, sigma)
    outside = np.maximum(np.abs(elevation_rad) - gate.half_aperture_rad, 0) / gate.edge_rad
    return np.asarray((residual**2).sum(axis=1) + outside**2), residual


def _chunks_of_tracks(first: IntArray, observation_count: int) -> list[slice]:
    """Divide the tracks into runs of about CHUNK_OBSERVATIONS observations."""
    cuts = np.searchsorted(first, np.arange(0, observation_count, CHUNK_OBSERVATIONS))
    edges = np.unique(np.append(cuts, len(first)))
    return [slice(int(a), int(b)) for a, b in pairwise(edges)]


def _search_elevations(
    observations: _Observations, chunk: slice, sonar: SonarModel, elevation_count: int
) -> FloatArray:
    """Return, for each track of the chunk, the arc point (3,) with the least truncated cost, world frame."""
    tracks, gate = observations.tracks, observations.gate
    stop = np.append(observations.first, len(tracks))[chunk.start + 1 : chunk.stop + 1]
    first = observations.first[chunk]
    reference = np.stack([first, (first + stop - 1) // 2, stop - 1], axis=1)
    arc = sonar.elevation_arc(tracks.range_m[reference], tracks.bearing_rad[reference], elevation_count)
    pose = observations.world_from_sonar[tracks.frame[reference]]
    candidates = (np.einsum("tkij,tkgj->tkgi", pose[..., :3, :3], arc) + pose[..., None, :3, 3]).reshape(
        len(first), -1, 3
    )
    observed = slice(int(first[0]), int(stop[-1]))
    track = tracks.track[observed] - chunk.start
    sonar_from_world, sigma = observations.sonar_from_world[observed], observations.sigma[observed]
    rotated = np.einsum("oij,ogj->ogi", sonar_from_world[:, :3, :3], candidates[track])
    range_m, bearing_rad, elevation_rad = project(rotated + sonar_from_world[:, None, :3, 3])
    cost = ((range_m - tracks.range_m[observed, None]) / sigma[:, :1]) ** 2
    cost += (angle_difference(bearing_rad, tracks.bearing_rad[observed, None]) / sigma[:, 1:]) ** 2
    half = gate.half_aperture_rad
    cost += (np.maximum(np.abs(elevation_rad) - half, 0) / gate.edge_rad) ** 2
    # Of elevations that fit equally well, take the middle one: a Gauss-Newton step from the edge would leave the arc.
    prior = (ELEVATION_PRIOR_SIGMAS * np.minimum(np.abs(elevation_rad) / half, 1)) ** 2 / (stop - first)[track, None]
    total = np.add.reduceat(np.minimum(cost, gate.truncation**2) + prior, first - first[0], axis=0)
    return np.asarray(candidates[np.arange(len(first)), total.argmin(axis=1)])


def _classify(xyz_m: FloatArray, observations: _Observations) -> tuple[BoolArray, FloatArray]:
    """Return which (O,) observations are inliers of their track's point, and the (O, 2) whitened residuals."""
    gate = observations.gate
    square, residual = squared_residuals(
        xyz_m, observations.tracks, observations.sonar_from_world, observations.sigma, gate
    )
    return square <= gate.truncation**2, residual


def _refine(xyz_m: FloatArray, observations: _Observations, inlier: BoolArray) -> FloatArray:
    """Return the (T, 3) points after one damped Gauss-Newton step over their inliers."""
    tracks, first, sigma = observations.tracks, observations.first, observations.sigma
    sonar_from_world, half = observations.sonar_from_world, observations.gate.half_aperture_rad
    in_sonar = transform(sonar_from_world, xyz_m[tracks.track])
    jacobian = np.einsum("oki,oij->okj", project_jacobian(in_sonar), sonar_from_world[:, :3, :3])
    range_m, bearing_rad, elevation_rad = project(in_sonar)
    # The elevation is not measured: a weak prior keeps points in the beam where the motion does not determine it.
    prior = np.full(len(tracks), ELEVATION_PRIOR_SIGMAS / half)
    scale = np.stack([1 / sigma[:, 0], 1 / sigma[:, 1], prior], axis=1)
    difference_rad = angle_difference(bearing_rad, tracks.bearing_rad)
    residual = np.stack([range_m - tracks.range_m, difference_rad, elevation_rad], axis=1)
    views = np.add.reduceat(inlier.astype(float), first)
    scale[:, 2] /= np.sqrt(np.maximum(views, 1.0))[tracks.track]
    scale = scale * inlier[:, None]
    jacobian = jacobian * scale[..., None]
    residual = residual * scale
    hessian = np.add.reduceat(np.einsum("oki,okj->oij", jacobian, jacobian), first, axis=0)
    gradient = np.add.reduceat(np.einsum("oki,ok->oi", jacobian, residual), first, axis=0)
    hessian += (1e-6 * np.trace(hessian, axis1=1, axis2=2)[:, None, None] + 1e-9) * np.eye(3)
    step = np.linalg.solve(hessian, gradient[..., None])[..., 0]
    length = np.linalg.norm(step, axis=1, keepdims=True)
    views = np.diff(first, append=len(tracks))[:, None]
    max_length = MAX_STEP_SHARE * np.maximum(np.add.reduceat(tracks.range_m, first)[:, None] / views, 1e-9)
    return np.asarray(xyz_m - step * np.minimum(1.0, max_length / np.maximum(length, 1e-12)))
