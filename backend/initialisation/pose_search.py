"""Search of initial poses for a sonar alone: planar odometry relaxed in six degrees of freedom, or a map grown anew.

Planar odometry knows no roll, pitch or height. It is kept where it fits nearly as well as short stretches of frames by
themselves. Elsewhere it is relaxed with sigmas that are wide at first; where the fit stays worse, it has stopped in a
wrong local optimum, and a map is grown frame by frame. The better fit is taken.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.backend.estimation.triangulation import Gate, triangulate_tracks
from asfm.backend.graph.dense_bundle import adjust_dense
from asfm.backend.graph.dense_problem import empty_problem, number_problem, whiten
from asfm.backend.initialisation.incremental_mapping import (
    IncrementalMap,
    adjust_in_windows,
    adjust_narrowing,
    draw_points,
    grow_map,
)
from asfm.backend.initialisation.planar_odometry import MIN_SHARED, TOLERANCE_PER_RANGE
from asfm.config import NoiseConfig
from asfm.geometry.feature_noise import observation_sigma
from asfm.geometry.poses import invert, make_pose, steps_between
from asfm.geometry.sonar import SonarModel
from asfm.navigation.outlier_filter import MAD_TO_SIGMA
from asfm.types import FloatArray, IntArray, Tracks

MIN_VIEWS = 3
"""Shorter tracks are not used."""
TRACKS_PER_FRAME = 120
"""Tracks used of a frame, the longest ones: a few hundred make the search slow and not better."""
MAX_PLANAR_MISFIT = 1.8
"""Residuals of the planar odometry over those of short stretches at which it is near enough to the truth: weakly
observed roll and pitch are better left at zero, and the rounds of the adjustment find what the measurements hold."""
MAX_MISFIT = 1.02
"""Residuals of all frames over those of short stretches at which the relaxed poses are accepted."""
CLEARLY_BETTER = 0.9
"""Cost of a grown map over that of the relaxed poses from which on it is taken."""
STRETCH_FRAMES, MIN_STRETCH_VIEWS, MIN_STRETCH_OBSERVATIONS = 8, 4, 40
"""Length of the short stretches, and the tracks and stretches that are used."""
PLANAR_SIGMA_SCALE, PLANAR_EDGE_RAD = 4.0, 0.05
"""Factor of the sigmas, and blur of the aperture's edge, with which tracks are triangulated under planar poses."""
STEP_FACTOR = 3.0
"""Standard deviation of a step in the search over the typical one: weak, but it holds frames with few tracks."""


@dataclass(frozen=True)
class _Fit:
    world_from_sonar: FloatArray
    """(N, 4, 4)"""
    cost: float
    """Mean of the observations' costs."""
    noise: FloatArray
    """(2,) robust standard deviation of the residuals of range and bearing, in sigmas."""


def search_poses(
    tracks: Tracks,
    planar_world_from_sonar: FloatArray,
    typical_step: FloatArray,
    sonar: SonarModel,
    noise: NoiseConfig,
    rng: np.random.Generator,
) -> FloatArray:
    """Search sonar poses in six degrees of freedom.

    Args:
        tracks: built without known poses.
        planar_world_from_sonar: (N, 4, 4) poses of the planar odometry.
        typical_step: (2,) rotation in rad and translation in m, each axis, of a typical step.
        sonar: gives range and aperture.
        noise: standard deviations of features without their own.
        rng: draws the elevations at which points begin.

    Returns:
        (N, 4, 4) poses, the first one that of the planar odometry. Those of the planar odometry where there are too few
        tracks, or where no fit keeps its steps.
    """
    tracks = select_tracks(tracks, len(planar_world_from_sonar))
    if tracks.count < MIN_SHARED:
        return planar_world_from_sonar
    sigma = observation_sigma(tracks, sonar, noise)
    half_rad, max_range_m = sonar.elevation_aperture_rad / 2, float(sonar.range_edges_m[-1])
    local = invert(planar_world_from_sonar[0]) @ planar_world_from_sonar
    template = empty_problem(half_rad, STEP_FACTOR * typical_step)
    start = IncrementalMap(tracks, sigma, template, max_range_m, local)
    if measure_misfit(start, local, _planar_noise(start, sonar), rng) <= MAX_PLANAR_MISFIT:
        return planar_world_from_sonar
    best = _relax(start, local, rng)
    agrees = _steps_agree(local, best, max_range_m)
    if not agrees or measure_misfit(start, best.world_from_sonar, best.noise, rng) > MAX_MISFIT:
        grown = _relax(start, grow_map(tracks, sigma, len(local), template, max_range_m, rng), rng)
        best = best if agrees and grown.cost >= CLEARLY_BETTER * best.cost else grown
    if not _steps_agree(local, best, max_range_m):
        return planar_world_from_sonar
    found = planar_world_from_sonar[0] @ invert(best.world_from_sonar[0]) @ best.world_from_sonar
    return make_pose(found[:, :3, 3], Rotation.from_matrix(found[:, :3, :3]))


def select_tracks(tracks: Tracks, frame_count: int) -> Tracks:
    """Return the tracks of enough views; where a frame has very many, those that are mostly among its longest.

    Args:
        tracks: any.
        frame_count: N.
    """
    views = np.bincount(tracks.track, minlength=tracks.count)
    rank = np.empty(len(tracks), dtype=np.int64)
    for seen in tracks.by_frame(frame_count):
        rank[seen[np.argsort(-views[tracks.track[seen]], kind="stable")]] = np.arange(len(seen))
    often = np.bincount(tracks.track, rank < TRACKS_PER_FRAME, minlength=tracks.count) >= views / 2
    chosen = tracks.select(((views >= MIN_VIEWS) & often)[tracks.track])
    return replace(chosen, track=np.unique(chosen.track, return_inverse=True)[1])


def measure_misfit(
    start: IncrementalMap, world_from_sonar: FloatArray, noise: FloatArray, rng: np.random.Generator
) -> float:
    """Return the noise of poses over that within short stretches of frames, each adjusted by itself; the larger axis.

    The few frames of a stretch fit in nearly any state, so that their residuals are the features' own noise.

    Args:
        start: gives tracks and sigmas.
        world_from_sonar: (N, 4, 4) poses of all frames, from which each stretch is started.
        noise: (2,) standard deviations of the residuals of range and bearing with these poses, in sigmas.
        rng: draws the elevations at which points begin.

    Returns:
        About 1 for the right poses; 1 where no stretch has enough observations.
    """
    tracks, residual, freedom, count = start.tracks, list[FloatArray](), 0, 0
    for first in range(0, len(world_from_sonar) - STRETCH_FRAMES + 1, STRETCH_FRAMES):
        used = np.flatnonzero((tracks.frame >= first) & (tracks.frame < first + STRETCH_FRAMES))
        used = used[np.bincount(tracks.track[used])[tracks.track[used]] >= MIN_STRETCH_VIEWS]
        if len(used) < MIN_STRETCH_OBSERVATIONS:
            continue
        whitened, fitted = _adjust_stretch(start, world_from_sonar, used, rng)
        residual.append(whitened)
        freedom += 2 * len(used) - fitted
        count += 2 * len(used)
    if not residual or freedom <= 0:
        return 1.0
    within = robust_sigma(np.concatenate(residual)) / np.sqrt(freedom / count)
    return float(np.max(noise / np.maximum(within, 1e-9)))


def _planar_noise(start: IncrementalMap, sonar: SonarModel) -> FloatArray:
    """Return the (2,) robust standard deviations, in sigmas, of tracks triangulated with the start's poses."""
    gate = Gate(sonar.elevation_aperture_rad / 2, PLANAR_EDGE_RAD)
    sigma = PLANAR_SIGMA_SCALE * start.sigma
    found = triangulate_tracks(start.tracks, start.world_from_sonar, sonar, sigma, gate)
    return PLANAR_SIGMA_SCALE * robust_sigma(found.residual)


def _steps_agree(planar_world_from_sonar: FloatArray, fit: _Fit, max_range_m: float) -> bool:
    """Tell whether a fit keeps every step of the planar odometry in its plane.

    Between neighbouring frames the planar motion is nearly right, and wrong matches are a minority. In a scene that
    repeats itself they may become the majority among all frames, and tear the map.
    """
    difference = invert(steps_between(planar_world_from_sonar)) @ steps_between(fit.world_from_sonar)
    moved_m = np.linalg.norm(difference[:, :2, 3], axis=1)
    return bool((moved_m <= TOLERANCE_PER_RANGE * max_range_m).all())


def robust_sigma(residual: FloatArray) -> FloatArray:
    """Return the (2,) standard deviations of (O, 2) residuals from their medians, which outliers do not move."""
    return np.asarray(MAD_TO_SIGMA * np.median(np.abs(residual), axis=0))


def _relax(start: IncrementalMap, world_from_sonar: FloatArray, rng: np.random.Generator) -> _Fit:
    """Adjust all frames from given poses and random elevations."""
    relaxed = replace(start, world_from_sonar=world_from_sonar.copy())
    adjust_in_windows(relaxed, rng)
    everything = np.arange(len(start.tracks))
    problem, frames, points = number_problem(start.template, start.tracks, start.sigma, everything)
    poses, xyz_m = relaxed.world_from_sonar[frames], relaxed.xyz_m[points]
    cost = adjust_dense(problem, poses, xyz_m, np.zeros(len(frames), dtype=bool), iterations=0).cost
    noise = robust_sigma(whiten(problem, poses, xyz_m))
    return _Fit(relaxed.world_from_sonar, cost / len(everything), noise)


def _adjust_stretch(
    start: IncrementalMap, world_from_sonar: FloatArray, used: IntArray, rng: np.random.Generator
) -> tuple[FloatArray, int]:
    """Adjust the frames and points of some observations: their (O, 2) residuals, and the parameters fitted."""
    problem, frames, points = number_problem(start.template, start.tracks, start.sigma, used)
    first = used[np.unique(problem.track, return_index=True)[1]]
    poses = world_from_sonar[start.tracks.frame[first]]
    xyz_m = draw_points(start.tracks, first, poses, start.template.half_aperture_rad, rng)
    bundle = adjust_narrowing(problem, world_from_sonar[frames], xyz_m, np.arange(len(frames)) > 0)
    return whiten(problem, bundle.world_from_sonar, bundle.xyz_m), 3 * len(points) + 6 * (len(frames) - 1)
