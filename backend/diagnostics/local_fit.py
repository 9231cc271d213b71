"""Goodness of fit against short stretches: residuals of the whole solution over those of a few frames fitted alone.

A solution that stopped in a wrong optimum, or features whose errors last along a track, leave larger residuals than the
same observations do where only a few frames have to agree. Without odometry nothing else contradicts a wrong solution.
"""

from dataclasses import dataclass, replace

import numpy as np

from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.dense_bundle import adjust_dense
from asfm.backend.graph.dense_problem import empty_problem, number_problem, whiten
from asfm.backend.graph.factors import CAUCHY_SIGMAS
from asfm.consistency import LocalFit
from asfm.diagnostics import Diagnostic, format_runs, frame_runs

WINDOW_FRAMES, STRIDE = 12, 6
"""Frames that are fitted alone, and frames from the first of one window to the first of the next."""
MIN_VIEWS, MIN_OBSERVATIONS = 4, 40
"""Shorter tracks within a window are not used, and windows with fewer observations tell nothing."""
STEP_FACTOR = 5.0
"""Standard deviation of a step within a window over that in the graph: a motion prior that is too tight is seen."""
ITERATIONS = 12
OUTLIER_SIGMAS = 3.0
MAX_RATIO = 1.38
"""Of 35 simulated runs of a sonar alone, those with up to 2.8 times the bound's error reach 1.36, and one at the bound
1.42; three of the four beyond 3 times reach 1.41 to 1.53, the fourth 1.18."""
MAX_LOST_SHARE = 0.2
"""Observations that fit their window and not the whole, over all."""


@dataclass(frozen=True)
class _WindowFit:
    """Residuals of one window: median squares in sigmas, a degree of freedom, and shares of outliers."""

    frames: slice
    whole: float
    alone: float
    lost_share: float

    @property
    def ratio(self) -> float:
        """Typical residual of the whole solution over that of the window alone."""
        return float(np.sqrt(self.whole / self.alone))


def measure_local_fit(solution: Solution) -> LocalFit:
    """Fit windows of :data:`WINDOW_FRAMES` frames alone and compare their residuals with those of the solution.

    All observations of the tracks in the graph count, rejected ones too. Median squares are divided by the share of
    the observations that the fitted poses and points leave free.

    Args:
        solution: converged, of N frames.
    """
    count = len(solution.bundle.world_from_vehicle)
    starts = range(0, max(count - WINDOW_FRAMES, 0) + 1, STRIDE)
    found = [fit for start in starts if (fit := _fit_window(solution, slice(start, start + WINDOW_FRAMES)))]
    if not found:
        return LocalFit()
    whole, alone = sum(fit.whole for fit in found), sum(fit.alone for fit in found)
    poor = np.zeros(count, dtype=bool)
    for fit in found:
        poor[fit.frames] |= fit.ratio > MAX_RATIO or fit.lost_share > MAX_LOST_SHARE
    lost_share = float(np.mean([fit.lost_share for fit in found]))
    ratio = float(np.sqrt(whole / alone))
    return LocalFit(ratio, lost_share, ratio > MAX_RATIO or lost_share > MAX_LOST_SHARE, frame_runs(poor))


def _fit_window(solution: Solution, frames: slice) -> _WindowFit | None:
    """Fit the poses and points of a window of frames alone, from where they are; None where it tells nothing."""
    tracks, problem, bundle = solution.tracks, solution.problem, solution.bundle
    near = bundle.in_graph[tracks.track] & (tracks.frame >= frames.start) & (tracks.frame < frames.stop)
    near &= (np.bincount(tracks.track, near, minlength=tracks.count) >= MIN_VIEWS)[tracks.track]
    used = np.flatnonzero(near)
    if len(used) < MIN_OBSERVATIONS or not len(problem.sensors.step_sigma):
        return None
    step_sigma = STEP_FACTOR * problem.sensors.step_sigma[frames.start : frames.stop - 1].max(axis=0)
    template = replace(empty_problem(problem.half_aperture_rad, step_sigma), cauchy_sigmas=CAUCHY_SIGMAS)
    dense, seen, points = number_problem(template, tracks, problem.sigma, used)
    world_from_sonar = (bundle.world_from_vehicle @ problem.vehicle_from_sonar)[seen]
    alone = adjust_dense(dense, world_from_sonar, bundle.xyz_m[points], np.arange(len(seen)) > 0, ITERATIONS)
    before = (whiten(dense, world_from_sonar, bundle.xyz_m[points]) ** 2).sum(axis=1)
    after = (whiten(dense, alone.world_from_sonar, alone.xyz_m) ** 2).sum(axis=1)
    free_share = _free_share(len(used), len(seen), len(points))
    if free_share <= 0 or not np.median(after) > 0:
        return None
    return _WindowFit(
        frames,
        whole=float(np.median(before)) / max(_free_share_of(solution), free_share),
        alone=float(np.median(after)) / free_share,
        lost_share=float(np.mean(before > OUTLIER_SIGMAS**2) - np.mean(after > OUTLIER_SIGMAS**2)),
    )


def _free_share_of(solution: Solution) -> float:
    """Return the share of the residuals of the whole solution that its poses and points leave free."""
    used = solution.observed
    frames, points = len(solution.bundle.world_from_vehicle), len(np.unique(solution.tracks.track[used]))
    return _free_share(int(used.sum()), frames, points)


def _free_share(observations: int, frames: int, points: int) -> float:
    """Return the share of the degrees of freedom of range and bearing that are left, of elevations none being counted.

    An elevation is hardly determined in a short window, and takes hardly a degree of freedom from the residuals.
    """
    return 1 - (6 * (frames - 1) + 2 * points) / (2 * observations) if observations else 0.0


def warn_of_poor_fit(fit: LocalFit | None) -> tuple[Diagnostic, ...]:
    """Report a solution that fits its observations much worse than short stretches of it do; None: not measured."""
    if fit is None or not fit.poor:
        return ()
    where = f", most of all in frames {format_runs(fit.poor_frames)}" if fit.poor_frames else ""
    message = (
        f"the solution fits its observations {fit.ratio:.2f} times worse than stretches of {WINDOW_FRAMES} frames do "
        f"by themselves (up to {MAX_RATIO:g} is expected), and {100 * max(fit.lost_share, 0):.0f} % of them not at all"
        f"{where}: poses and points may be several times farther from the truth than their sigmas say"
    )
    return (Diagnostic("poor-fit", message, fit.poor_frames),)
