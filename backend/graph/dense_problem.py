"""Dense bundle adjustment problem: observations of points from sonar poses, weak priors, and whitened residuals."""

from dataclasses import dataclass, replace

import numpy as np

from asfm.geometry.poses import angle_difference
from asfm.geometry.sonar import project
from asfm.types import FloatArray, IntArray, Tracks

CAUCHY_SIGMAS = 3.0
"""Scale of the Cauchy kernel."""
ELEVATION_SIGMA = 0.85
"""Standard deviation of a point's elevation, in half apertures."""


@dataclass(frozen=True)
class DenseProblem:
    """Observations of T points from N sonar poses, and weak knowledge of the motion and the elevations."""

    frame: IntArray
    """(O,) pose of each observation, 0..N-1."""
    track: IntArray
    """(O,) point of each observation, 0..T-1; at most one observation of a point in a pose."""
    range_bearing: FloatArray
    """(O, 2) range_m and bearing_rad."""
    sigma: FloatArray
    """(O, 2) their standard deviations."""
    step_sigma: FloatArray
    """(N - 1, 2) standard deviations of rotation in rad and translation in m, each axis, from each pose to the next, of
    which the mean is no motion; infinite where nothing is known."""
    half_aperture_rad: float
    """Half of the elevation aperture."""
    elevation_sigma_rad: float = np.inf
    """Standard deviation of a point's elevation, whose mean is the middle of the beam; once per point."""
    point_sigma_m: float = np.inf
    """Standard deviation of each point about where it is at the beginning."""
    cauchy_sigmas: float = np.inf
    """Scale of the Cauchy kernel on an observation's range and bearing together; infinite for least squares."""


def empty_problem(half_aperture_rad: float, step_sigma: FloatArray) -> DenseProblem:
    """Return a problem without observations, with the kernel and the priors of the adjustments.

    Args:
        half_aperture_rad: half of the elevation aperture.
        step_sigma: (2,) standard deviations of rotation in rad and translation in m, each axis, of a step between
            neighbouring frames.
    """
    index = np.zeros(0, dtype=np.int64)
    return DenseProblem(
        frame=index,
        track=index,
        range_bearing=np.zeros((0, 2)),
        sigma=np.zeros((0, 2)),
        step_sigma=step_sigma[None],
        half_aperture_rad=half_aperture_rad,
        elevation_sigma_rad=ELEVATION_SIGMA * half_aperture_rad,
        cauchy_sigmas=CAUCHY_SIGMAS,
    )


def number_problem(
    template: DenseProblem, tracks: Tracks, sigma: FloatArray, used: IntArray
) -> tuple[DenseProblem, IntArray, IntArray]:
    """Return the problem of some observations with numbered frames and points, (F,) its frames and (P,) its tracks."""
    frames, frame = np.unique(tracks.frame[used], return_inverse=True)
    points, track = np.unique(tracks.track[used], return_inverse=True)
    step_sigma = np.outer(np.sqrt(np.diff(frames)), template.step_sigma[0])
    range_bearing = np.stack([tracks.range_m[used], tracks.bearing_rad[used]], axis=1)
    problem = replace(
        template, frame=frame, track=track, range_bearing=range_bearing, sigma=sigma[used], step_sigma=step_sigma
    )
    return problem, frames, points


def scale_sigmas(problem: DenseProblem, factor: float) -> DenseProblem:
    """Return the problem with the sigmas of its observations multiplied by a factor."""
    return replace(problem, sigma=problem.sigma * factor)


def whiten(problem: DenseProblem, world_from_sonar: FloatArray, xyz_m: FloatArray) -> FloatArray:
    """Return the (O, 2) residuals of range and bearing in sigmas."""
    return whiten_observed(problem, observed_points(problem, world_from_sonar, xyz_m))[:, :2]


def whiten_observed(problem: DenseProblem, in_sonar: FloatArray) -> FloatArray:
    """Return the (O, 3) residuals of range, bearing and elevation, in sigmas, of (O, 3) points in the sonar frames."""
    range_m, bearing_rad, elevation_rad = project(in_sonar)
    range_error_m = range_m - problem.range_bearing[:, 0]
    bearing_error_rad = angle_difference(bearing_rad, problem.range_bearing[:, 1])
    return np.column_stack([range_error_m, bearing_error_rad, elevation_rad]) / all_sigmas(problem)


def all_sigmas(problem: DenseProblem) -> FloatArray:
    """Return the (O, 3) sigmas of range, bearing and elevation."""
    return np.column_stack([problem.sigma, elevation_sigma(problem)])


def observed_points(problem: DenseProblem, world_from_sonar: FloatArray, xyz_m: FloatArray) -> FloatArray:
    """Return the (O, 3) points of the observations in the sonar frames that see them."""
    pose = world_from_sonar[problem.frame]
    return np.asarray(((xyz_m[problem.track] - pose[:, :3, 3])[:, None] @ pose[:, :3, :3])[:, 0])


def elevation_sigma(problem: DenseProblem) -> FloatArray:
    """Return the (O,) sigmas of the elevation, larger by the root of the views of each point."""
    return np.asarray(problem.elevation_sigma_rad * np.sqrt(np.bincount(problem.track)[problem.track]))
