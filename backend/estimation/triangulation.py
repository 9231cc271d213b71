"""Triangulation made for sonar: every track at once, over a grid of elevations, with a truncated cost."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import SonarModel, project, project_jacobian
from asfm.types import BoolArray, FloatArray, IntArray, Tracks

OBSERVATIONS_AT_ONCE = 20_000
MIDDLE_PULL = 0.3
"""Weight of a track's pull to the middle of its beams: its cost in squared sigmas at the edge is the square of this."""


@dataclass(frozen=True)
class Gate:
    """How far an observation may lie from its point before it counts as wrong."""

    half_aperture_rad: float
    edge_rad: float
    """Standard deviation of the elevation beyond the edge of the aperture: beams do not end sharply, and the attitudes
    are not exact."""
    truncation: float = 3.0
    """Residual, in sigmas."""


@dataclass(frozen=True)
class Triangulation:
    """One point a track, and which observations agree with it."""

    xyz_m: FloatArray
    """(T, 3) in the world frame."""
    inlier: BoolArray
    """(O,) the observation lies within the truncation of its track's point and the point inside the aperture."""
    residual: FloatArray
    """(O, 2) whitened residual in range and bearing."""


def triangulate_tracks(
    tracks: Tracks,
    world_from_sonar: FloatArray,
    sonar: SonarModel,
    sigma: FloatArray,
    gate: Gate,
    elevation_count: int = 21,
) -> Triangulation:
    """Place each track's point where most of its observations agree.

    Candidates are the points of the elevation arcs (equation (2) with the elevation unknown) of the track's first,
    middle and last observation. The best under the truncated squared cost is refined by Gauss-Newton steps over the
    observations that agree with it.

    Args:
        tracks: (O,) observations sorted by track.
        world_from_sonar: (N, 4, 4) poses of the frames.
        sonar: gives the aperture.
        sigma: (O, 2) standard deviations of range_m and bearing_rad, pose errors included.
        gate: when an observation counts as wrong; also bounds the elevation.
        elevation_count: points of the grid.
    """
    count = tracks.count
    if count == 0:
        return Triangulation(np.zeros((0, 3)), np.zeros(0, dtype=bool), np.zeros((0, 2)))
    start = np.searchsorted(tracks.track, np.arange(count))
    sonar_from_world = invert(world_from_sonar)[tracks.frame]
    xyz_m = np.empty((count, 3))
    for chunk in _chunks_of_tracks(start, len(tracks)):
        xyz_m[chunk] = _search(
            tracks, start, chunk, world_from_sonar, sonar_from_world, sonar, sigma, gate, elevation_count
        )
    for _ in range(4):
        inlier, _ = _classify(xyz_m, tracks, sonar_from_world, sigma, gate)
        xyz_m = _refine(xyz_m, tracks, inlier, sonar_from_world, sigma, gate.half_aperture_rad)
    inlier, residual = _classify(xyz_m, tracks, sonar_from_world, sigma, gate)
    return Triangulation(xyz_m, inlier, residual)


def whitened_residuals(
    xyz_m: FloatArray, tracks: Tracks, sonar_from_world: FloatArray, sigma: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compare each observation with its track's point.

    Args:
        xyz_m: (T, 3) points, world frame.
        sonar_from_world: (O, 4, 4), one an observation.

    Returns:
        (O, 2) residuals of range and bearing in sigmas, (O,) elevation_rad at which the frame sees the point.
    """
    range_m, bearing_rad, elevation_rad = project(transform(sonar_from_world, xyz_m[tracks.track]))
    residual = np.stack([range_m - tracks.range_m, bearing_rad - tracks.bearing_rad], axis=-1) / sigma
    return residual, elevation_rad


def squared_residuals(
    xyz_m: FloatArray, tracks: Tracks, sonar_from_world: FloatArray, sigma: FloatArray, gate: Gate
) -> tuple[FloatArray, FloatArray]:
    """Square the (O,) misfit of each observation, how far its point lies outside the beam included.

    Returns:
        (O,) squares, and the (O, 2) whitened residuals in them.
    """
    residual, elevation_rad = whitened_residuals(xyz_m, tracks, sonar_from_world, sigma)
    outside = np.maximum(np.abs(elevation_rad) - gate.half_aperture_rad, 0) / gate.edge_rad
    return np.asarray((residual**2).sum(axis=1) + outside**2), residual


def _chunks_of_tracks(start: IntArray, observation_count: int) -> list[slice]:
    """Cut the tracks into runs of about OBSERVATIONS_AT_ONCE observations, to bound memory."""
    cuts = np.searchsorted(start, np.arange(0, observation_count, OBSERVATIONS_AT_ONCE))
    edges = np.unique(np.append(cuts, len(start)))
    return [slice(int(a), int(b)) for a, b in pairwise(edges)]


def _search(
    tracks: Tracks,
    start: IntArray,
    chunk: slice,
    world_from_sonar: FloatArray,
    sonar_from_world: FloatArray,
    sonar: SonarModel,
    sigma: FloatArray,
    gate: Gate,
    elevation_count: int,
) -> FloatArray:
    """Pick, for each track of the chunk, the arc point with the smallest truncated cost."""
    stop = np.append(start, len(tracks))[chunk.start + 1 : chunk.stop + 1]
    first = start[chunk]
    reference = np.stack([first, (first + stop - 1) // 2, stop - 1], axis=1)
    arc = sonar.elevation_arc(tracks.range_m[reference], tracks.bearing_rad[reference], elevation_count)
    pose = world_from_sonar[tracks.frame[reference]]
    candidates = (np.einsum("tkij,tkgj->tkgi", pose[..., :3, :3], arc) + pose[..., None, :3, 3]).reshape(
        len(first), -1, 3
    )
    observed = slice(int(first[0]), int(stop[-1]))
    track = tracks.track[observed] - chunk.start
    seen = np.einsum("oij,ogj->ogi", sonar_from_world[observed, :3, :3], candidates[track])
    range_m, bearing_rad, elevation_rad = project(seen + sonar_from_world[observed, None, :3, 3])
    sigma = sigma[observed]
    cost = ((range_m - tracks.range_m[observed, None]) / sigma[:, :1]) ** 2
    cost += ((bearing_rad - tracks.bearing_rad[observed, None]) / sigma[:, 1:]) ** 2
    half = gate.half_aperture_rad
    cost += (np.maximum(np.abs(elevation_rad) - half, 0) / gate.edge_rad) ** 2
    # Of elevations that fit alike, take the middle one: a step there from the beam's edge would leave the arc.
    pull = (MIDDLE_PULL * np.minimum(np.abs(elevation_rad) / half, 1)) ** 2 / (stop - first)[track, None]
    total = np.add.reduceat(np.minimum(cost, gate.truncation**2) + pull, first - first[0], axis=0)
    return np.asarray(candidates[np.arange(len(first)), total.argmin(axis=1)])


def _classify(
    xyz_m: FloatArray, tracks: Tracks, sonar_from_world: FloatArray, sigma: FloatArray, gate: Gate
) -> tuple[BoolArray, FloatArray]:
    """Tell which observations agree with their track's point: (O,), and give their (O, 2) whitened residuals."""
    square, residual = squared_residuals(xyz_m, tracks, sonar_from_world, sigma, gate)
    return square <= gate.truncation**2, residual


def _refine(
    xyz_m: FloatArray,
    tracks: Tracks,
    inlier: BoolArray,
    sonar_from_world: FloatArray,
    sigma: FloatArray,
    half: float,
) -> FloatArray:
    """Take one damped Gauss-Newton step for every point, over the observations that agree."""
    seen = transform(sonar_from_world, xyz_m[tracks.track])
    jacobian = np.einsum("oki,oij->okj", project_jacobian(seen), sonar_from_world[:, :3, :3])
    range_m, bearing_rad, elevation_rad = project(seen)
    # The elevation is not measured; a weak pull to the middle of the beam keeps unobservable points inside it.
    scale = np.stack([1 / sigma[:, 0], 1 / sigma[:, 1], np.full(len(tracks), MIDDLE_PULL / half)], axis=1)
    residual = np.stack([range_m - tracks.range_m, bearing_rad - tracks.bearing_rad, elevation_rad], axis=1)
    first = np.searchsorted(tracks.track, np.arange(len(xyz_m)))
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
    farthest = 0.2 * np.maximum(
        np.add.reduceat(tracks.range_m, first)[:, None] / np.diff(first, append=len(tracks))[:, None], 1e-9
    )
    return np.asarray(xyz_m - step * np.minimum(1.0, farthest / np.maximum(length, 1e-12)))
