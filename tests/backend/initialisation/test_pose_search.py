"""Search of initial poses: roll and pitch are found where planar odometry knows none; wrong matches change nothing."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.backend.graph.dense_problem import empty_problem
from asfm.backend.initialisation import pose_search
from asfm.backend.initialisation.incremental_mapping import IncrementalMap
from asfm.backend.initialisation.initial_poses import initialise_from_tracks, search_from_tracks
from asfm.backend.initialisation.planar_odometry import planar_odometry
from asfm.backend.initialisation.pose_search import robust_sigma, search_poses, select_tracks
from asfm.config import BackendConfig, Config, NoiseConfig
from asfm.navigation.frame_navigation import read_navigation
from asfm.sequence import Sequence
from asfm.types import FloatArray, Tracks
from tests.six_axis_tracks import SONAR, make_path, measure_errors, observe
from tests.worlds import NO_TRACKS, no_frame

STEP = np.array([0.03, 0.08])


def chain(tracks: Tracks, frames: int) -> FloatArray:
    return planar_odometry(tracks, frames, np.eye(4), np.eye(4), np.random.default_rng(0))[0]


def search(tracks: Tracks, planar: FloatArray) -> FloatArray:
    return search_poses(tracks, planar, STEP, SONAR, NoiseConfig(), np.random.default_rng(0))


def test_roll_and_pitch_are_found() -> None:
    truth = make_path(40)
    tracks = observe(truth)
    planar = chain(tracks, 40)
    found = search(tracks, planar)
    assert measure_errors(planar, truth)[1] > 2.0
    position_m, rotation_deg = measure_errors(found, truth)
    assert position_m < 0.03
    assert rotation_deg < 0.6
    np.testing.assert_allclose(found[0], planar[0], atol=1e-12)


def test_initial_poses_are_searched_only_without_other_sensors() -> None:
    truth = make_path(30)
    tracks = observe(truth)
    sequence = Sequence("six axes", SONAR, np.arange(30) / 5, no_frame)
    navigation = read_navigation(sequence, BackendConfig())
    planar = initialise_from_tracks(navigation, sequence, tracks, Config(), np.random.default_rng(0))
    found = search_from_tracks(planar, sequence, tracks, Config(), np.random.default_rng(0))
    assert measure_errors(planar.world_from_vehicle, truth)[1] > 2.0
    assert measure_errors(found.world_from_vehicle, truth)[1] < 1.0
    level = replace(planar.sensors, z_roll_pitch=np.zeros((30, 3)), z_roll_pitch_sigma=np.full((30, 3), 0.01))
    measured = replace(planar, sensors=level)
    assert search_from_tracks(measured, sequence, tracks, Config(), np.random.default_rng(0)) is measured


def test_misfit_is_measured_against_short_stretches() -> None:
    truth = make_path(40, turn_deg=5.0)
    tracks = observe(truth)
    local = chain(tracks, 40)
    start = IncrementalMap(tracks, np.asarray(tracks.sigma), empty_problem(np.deg2rad(10), 3 * STEP), 6.0, local)
    rng = np.random.default_rng(0)
    noise = np.array([1.0, 1.0])
    assert 0.8 < pose_search.measure_misfit(start, truth, noise, rng) < 1.3
    assert pose_search.measure_misfit(start, truth, 3 * noise, rng) > pose_search.MAX_PLANAR_MISFIT


def test_planar_motion_is_left_as_it_is() -> None:
    truth = make_path(30, turn_deg=0.0)
    tracks = observe(truth, noise=4.0)
    planar = chain(tracks, 30)
    np.testing.assert_array_equal(search(tracks, planar), planar)


def test_tracks_of_a_scene_that_repeats_itself_do_not_tear_the_map() -> None:
    """Most long tracks jump to other points after some frames; matches between neighbours are mostly right."""
    truth = make_path(30, turn_deg=0.5)
    tracks = observe(truth)
    planar = chain(tracks, 30)
    half = np.unique(tracks.track)[::2]
    other = dict(zip(half.tolist(), np.roll(half, 7).tolist(), strict=True))
    late = (tracks.frame > 15) & np.isin(tracks.track, half)
    moved = np.where(late, [other.get(track, track) for track in tracks.track.tolist()], tracks.track)
    order = np.lexsort((tracks.frame, moved))
    sigma = np.asarray(tracks.sigma)[order]
    torn = Tracks(moved[order], tracks.frame[order], tracks.range_m[order], tracks.bearing_rad[order], sigma)
    found = search(torn, planar)
    error_m = measure_errors(found, truth)[0]
    assert error_m < 1.5 * measure_errors(planar, truth)[0] + 0.02


def test_too_few_tracks_leave_the_poses_as_they_are() -> None:
    planar = make_path(6)
    np.testing.assert_array_equal(search(NO_TRACKS, planar), planar)


def test_longest_tracks_of_crowded_frames_are_selected(monkeypatch: pytest.MonkeyPatch) -> None:
    lengths = np.array([2, 3, 8, 8, 8, 5, 4])
    track = np.repeat(np.arange(7), lengths)
    frame = np.concatenate([np.arange(length) for length in lengths])
    tracks = Tracks(track, frame, np.ones(len(track)), np.zeros(len(track)))
    everything = select_tracks(tracks, 8)
    assert np.bincount(everything.track).tolist() == [3, 8, 8, 8, 5, 4]
    monkeypatch.setattr(pose_search, "TRACKS_PER_FRAME", 3)
    assert np.bincount(select_tracks(tracks, 8).track).tolist() == [8, 8, 8]


def test_robust_sigma_is_that_of_the_core() -> None:
    residual = np.random.default_rng(0).normal(size=(20_000, 2)) * [1.0, 3.0]
    residual[:1000] += 100
    np.testing.assert_allclose(robust_sigma(residual), [1.0, 3.0], rtol=0.1)
