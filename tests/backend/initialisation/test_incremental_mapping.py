"""Incremental mapping: poses of a sonar that rolls and pitches are found from its tracks alone."""

import numpy as np
import pytest

from asfm.backend.graph.dense_problem import empty_problem, number_problem
from asfm.backend.graph.normal_equations import move_poses
from asfm.backend.initialisation import incremental_mapping
from asfm.backend.initialisation.incremental_mapping import (
    IncrementalMap,
    adjust_in_windows,
    draw_points,
    grow_map,
)
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import project
from tests.six_axis_tracks import SONAR, make_path, measure_errors, observe

HALF_RAD = SONAR.elevation_aperture_rad / 2
TEMPLATE = empty_problem(HALF_RAD, np.array([0.1, 0.3]))
MAX_RANGE_M = 6.0


@pytest.mark.parametrize("sigma_scale", [0.25, 1.0, 4.0])
def test_poses_are_found_whatever_the_stated_noise(sigma_scale: float) -> None:
    truth = make_path(30)
    tracks = observe(truth)
    assert tracks.sigma is not None
    poses = grow_map(tracks, sigma_scale * tracks.sigma, 30, TEMPLATE, MAX_RANGE_M, np.random.default_rng(0))
    position_m, rotation_deg = measure_errors(poses, truth)
    assert position_m < 0.05
    assert rotation_deg < 1.5


def test_same_elevations_give_the_same_poses_and_others_nearly_the_same() -> None:
    tracks = observe(make_path(20))
    assert tracks.sigma is not None
    one, again, other = (
        grow_map(tracks, tracks.sigma, 20, TEMPLATE, MAX_RANGE_M, np.random.default_rng(seed)) for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(one, again)
    assert measure_errors(other, one)[0] < 0.01


def test_frame_without_known_points_keeps_the_pose_before_it() -> None:
    tracks = observe(make_path(12))
    tracks = tracks.select(tracks.frame < 8)
    assert tracks.sigma is not None
    poses = grow_map(tracks, tracks.sigma, 12, TEMPLATE, MAX_RANGE_M, np.random.default_rng(0))
    np.testing.assert_allclose(poses[8:], np.broadcast_to(poses[7], (4, 4, 4)), atol=1e-3)


def test_windows_relax_a_long_sequence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(incremental_mapping, "LONGEST_WINDOW", 16)
    truth = make_path(40)
    tracks = observe(truth)
    assert tracks.sigma is not None
    motion = np.cumsum(0.004 * np.random.default_rng(2).normal(size=(40, 6)), axis=0)
    motion[0] = 0
    disturbed = IncrementalMap(tracks, tracks.sigma, TEMPLATE, MAX_RANGE_M, move_poses(truth, motion))
    before = measure_errors(disturbed.world_from_sonar, truth)
    adjust_in_windows(disturbed, np.random.default_rng(0))
    assert measure_errors(disturbed.world_from_sonar, truth)[1] < 0.7 * before[1]


def test_points_are_drawn_on_their_elevation_arcs() -> None:
    truth = make_path(5)
    tracks = observe(truth)
    chosen = np.arange(0, len(tracks), 3)
    xyz_m = draw_points(tracks, chosen, truth[tracks.frame[chosen]], HALF_RAD, np.random.default_rng(0))
    range_m, bearing_rad, elevation_rad = project(transform(invert(truth)[tracks.frame[chosen]], xyz_m))
    np.testing.assert_allclose(range_m, tracks.range_m[chosen], atol=1e-9)
    np.testing.assert_allclose(bearing_rad, tracks.bearing_rad[chosen], atol=1e-9)
    assert np.abs(elevation_rad).max() <= HALF_RAD
    assert elevation_rad.std() > 0.4 * HALF_RAD


def test_steps_over_missing_frames_are_less_certain() -> None:
    tracks = observe(make_path(9))
    assert tracks.sigma is not None
    used = np.flatnonzero(np.isin(tracks.frame, [0, 4, 5]))
    problem, frames, points = number_problem(TEMPLATE, tracks, tracks.sigma, used)
    assert frames.tolist() == [0, 4, 5]
    np.testing.assert_allclose(problem.step_sigma, [[0.2, 0.6], [0.1, 0.3]])
    np.testing.assert_array_equal(points[problem.track], tracks.track[used])
