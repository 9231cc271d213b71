"""Local fit: a right solution fits the whole as well as short windows of it, a wrong one does not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.diagnostics.local_fit import MAX_RATIO, WINDOW_FRAMES, measure_local_fit, warn_of_poor_fit
from asfm.backend.estimation.solution import Solution, solve_tracks
from asfm.config_file import load_config
from asfm.consistency import LocalFit
from asfm.geometry.poses import make_pose
from asfm.types import FloatArray, Tracks
from tests.oscillating_roll import make_case


def solve(error: FloatArray | None = None, step_sigma: tuple[float, float] | None = None) -> Solution:
    """Solve from the truth, with errors (O, 2) added, or another motion prior."""
    tracks, sequence, sensors, truth = make_case()
    if error is not None:
        tracks = replace(tracks, range_m=tracks.range_m + error[:, 0], bearing_rad=tracks.bearing_rad + error[:, 1])
    if step_sigma is not None:
        sensors = replace(sensors, step_sigma=np.tile(step_sigma, (len(sensors.step_sigma), 1)))
    return solve_tracks(tracks, sequence, truth, sensors, load_config())


def test_a_right_solution_fits_the_whole_as_well_as_its_parts() -> None:
    fit = measure_local_fit(solve())
    assert 0.9 < fit.ratio < 1.15 and abs(fit.lost_share) < 0.02
    assert not fit.poor and fit.poor_frames == () and warn_of_poor_fit(fit) == ()


def test_a_solution_held_by_a_wrong_prior_fits_poorly() -> None:
    """A motion prior that allows no roll: short windows, under a wider one, fit their observations better."""
    fit = measure_local_fit(solve(step_sigma=(0.004, 0.02)))
    assert fit.poor and fit.ratio > MAX_RATIO and fit.poor_frames
    (found,) = warn_of_poor_fit(fit)
    assert found.code == "poor-fit" and found.frames == fit.poor_frames and f"{fit.ratio:.2f} times" in found.message


def test_observations_that_fit_nowhere_but_in_their_window_are_counted() -> None:
    fit = LocalFit(1.1, 0.4, True, ((3, 9),))
    assert "40 % of them not at all, most of all in frames 3-9" in warn_of_poor_fit(fit)[0].message


def test_larger_white_noise_is_no_poor_fit() -> None:
    """The noise of the windows is the measure, not the stated one."""
    tracks = make_case()[0]
    assert tracks.sigma is not None
    error = np.random.default_rng(1).normal(0, 1.0, (len(tracks), 2)) * tracks.sigma
    assert not measure_local_fit(solve(error=error)).poor


def test_errors_that_grow_along_a_track_fit_poorly() -> None:
    """Features that slide: each window explains its part by points of its own."""
    tracks = make_case()[0]
    assert tracks.sigma is not None
    along = _along(tracks) / WINDOW_FRAMES
    error = 4 * (along * np.random.default_rng(2).choice([-1, 1], tracks.count)[tracks.track])[:, None] * tracks.sigma
    assert measure_local_fit(solve(error=error)).ratio > measure_local_fit(solve()).ratio + 0.05


def _along(tracks: Tracks) -> FloatArray:
    """Return the (O,) frames from the middle of each observation's track."""
    middle = np.bincount(tracks.track, tracks.frame) / np.bincount(tracks.track)
    return np.asarray(tracks.frame - middle[tracks.track])


def test_poses_off_their_optimum_fit_poorly() -> None:
    """The windows start at the poses of the solution; moved ones are set right in them."""
    solution = solve()
    poses = solution.bundle.world_from_vehicle.copy()
    poses[::2] = poses[::2] @ make_pose(np.array([0.05, -0.03, 0.0]), Rotation.identity())
    moved = replace(solution, bundle=replace(solution.bundle, world_from_vehicle=poses))
    fit = measure_local_fit(moved)
    assert fit.poor and len(fit.poor_frames) == 1


@pytest.mark.parametrize("kept", [0, 30])
def test_few_observations_tell_nothing(kept: int) -> None:
    solution = solve()
    in_graph = np.arange(solution.tracks.count) < kept // 10
    sparse = replace(solution, bundle=replace(solution.bundle, in_graph=in_graph))
    assert measure_local_fit(sparse) == LocalFit()
    assert warn_of_poor_fit(None) == ()
