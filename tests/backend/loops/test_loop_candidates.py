"""Loop candidates: pairs that overlap and share few landmarks, never across undetermined steps, chosen evenly."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.relative_covariance import joint_covariance, predict_sigma
from asfm.backend.loops.loop_candidates import (
    TYPICAL_RANGE_SHARE,
    LoopPair,
    LoopSearch,
    choose_pairs,
    find_neighbours,
    search_loops,
)
from asfm.config import LoopsConfig
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import back_project, project
from asfm.types import Tracks
from tests.backend.loops.round_trip import SONAR, make_round_trip

WINDOW = 8


def test_search_finds_the_way_back() -> None:
    """Pairs of the way out and the way back that are at the same place, and none within the window."""
    trip = make_round_trip(1)
    search = search_loops(trip.solution, trip.sequence, LoopsConfig(), WINDOW)
    assert search.pairs
    place_m = trip.truth[:, 1, 3]
    for pair in search.pairs.values():
        assert pair.frame_b - pair.frame_a > WINDOW
        assert 0 < pair.range_sigma_m < 1 and 0 < pair.bearing_sigma_rad < 0.5
        assert pair.overlap >= LoopsConfig().min_overlap
        assert abs(place_m[pair.frame_a] - place_m[pair.frame_b]) < 6
    best = max(search.pairs.values(), key=lambda pair: pair.overlap)
    assert best.frame_a < 15 <= best.frame_b


def _with_sensors(solution: Solution, measured: bool, loose: dict[int, float]) -> Solution:
    """Return the same solution under other sensors; loose: factor of the sigmas of some steps."""
    sensors = solution.problem.sensors
    step_sigma = sensors.step_sigma.copy()
    for step, factor in loose.items():
        step_sigma[step] *= factor
    sensors = replace(sensors, measured=measured, step_sigma=step_sigma)
    return replace(solution, problem=replace(solution.problem, sensors=sensors))


TURN = 14
"""The step of a round trip that no track bridges."""


@pytest.mark.parametrize(
    ("measured", "loose", "crosses"),
    [
        (True, {}, True),
        (True, {TURN: 1.9}, True),
        (True, {TURN: 5.0}, False),
        (True, dict.fromkeys(range(TURN), 5.0), True),
        (False, {}, False),
    ],
)
def test_no_pair_crosses_an_undetermined_step(measured: bool, loose: dict[int, float], crosses: bool) -> None:
    """Odometry determines every step unless it is unreliable, and tracks every step except the turn."""
    trip = make_round_trip(1)
    search = search_loops(_with_sensors(trip.solution, measured, loose), trip.sequence, LoopsConfig(), WINDOW)
    assert any(a <= TURN < b for a, b in search.pairs) == crosses
    if crosses:
        assert search.pairs == search_loops(trip.solution, trip.sequence, LoopsConfig(), WINDOW).pairs


@pytest.mark.parametrize(("bridges", "crosses"), [(5, False), (6, True)])
def test_step_is_determined_by_as_many_landmarks_as_a_loop_needs(bridges: int, crosses: bool) -> None:
    """Without odometry, a number of landmarks of the way out are observed once more after the turn."""
    trip = make_round_trip(1)
    solution = _with_sensors(trip.solution, False, {})
    tracks = solution.tracks
    chosen = np.unique(tracks.track[tracks.frame == TURN])[:bridges]
    table = np.stack([tracks.track, tracks.frame], axis=1)
    more = np.stack([chosen, np.full(len(chosen), TURN + 1)], axis=1)
    track, frame = np.concatenate([table, more]).T
    order = np.lexsort((frame, track))
    range_m, bearing_rad = (np.append(part, part[: len(chosen)]) for part in (tracks.range_m, tracks.bearing_rad))
    longer = Tracks(track[order], frame[order], range_m[order], bearing_rad[order])
    solution = replace(solution, tracks=longer, observed=np.ones(len(longer), dtype=bool))
    search = search_loops(solution, trip.sequence, LoopsConfig(), WINDOW)
    assert len(chosen) == bridges
    assert any(a <= TURN < b for a, b in search.pairs) == crosses


def test_frames_that_share_landmarks_are_no_candidates() -> None:
    trip = make_round_trip(1)
    everything = LoopsConfig(max_shared=0)
    few, many = (
        search_loops(trip.solution, trip.sequence, settings, WINDOW) for settings in (everything, LoopsConfig())
    )
    assert set(few.pairs) <= set(many.pairs)
    used = trip.solution.tracks
    for a, b in few.pairs:
        assert not np.intersect1d(used.track[used.frame == a], used.track[used.frame == b]).size


ALL_OVERLAP = LoopsConfig(sigma_factor=1000.0, min_overlap=1e-6)
"""Settings under which the uncertainty is so large that all frames may see the same."""


@pytest.mark.parametrize("max_shared", [0, 3, 1000])
def test_candidates_are_all_pairs_beyond_the_window_that_share_few_enough_landmarks(max_shared: int) -> None:
    trip = make_round_trip(1)
    settings, used = ALL_OVERLAP.model_copy(update={"max_shared": max_shared}), trip.solution.tracks
    landmarks = [set(used.track[used.frame == frame].tolist()) for frame in range(30)]
    expected = {(a, b) for a in range(30) for b in range(a + 4, 30) if len(landmarks[a] & landmarks[b]) <= max_shared}
    assert set(search_loops(trip.solution, trip.sequence, settings, 3).pairs) == expected


def test_landmarks_outside_the_graph_determine_no_step() -> None:
    trip = make_round_trip(1)
    solution, settings = _with_sensors(trip.solution, False, {}), ALL_OVERLAP.model_copy(update={"max_shared": 1000})
    nowhere = replace(solution.bundle, in_graph=np.zeros(len(solution.bundle.xyz_m), dtype=bool))
    assert search_loops(solution, trip.sequence, settings, 3).pairs
    assert not search_loops(replace(solution, bundle=nowhere), trip.sequence, settings, 3).pairs


LEVER_ARM = make_pose(np.array([0.5, -0.3, 0.2]), Rotation.from_euler("ZYX", [0.3, 0.1, -0.1]))


def test_sigmas_are_those_of_a_point_at_the_typical_range_times_the_factor() -> None:
    trip = make_round_trip(1)
    sequence, frames = replace(trip.sequence, vehicle_from_sonar=LEVER_ARM), np.arange(30)
    found = search_loops(trip.solution, sequence, LoopsConfig(sigma_factor=3.0, min_overlap=1e-6), WINDOW).pairs
    covariance = joint_covariance(trip.solution.bundle, frames)
    range_m = TYPICAL_RANGE_SHARE * SONAR.range_edges_m[-1]
    expected = predict_sigma(covariance, trip.solution.bundle.world_from_vehicle, LEVER_ARM, range_m)
    for (a, b), pair in found.items():
        assert pair.range_sigma_m == pytest.approx(3 * expected.range_m[a, b])
        assert pair.bearing_sigma_rad == pytest.approx(3 * expected.bearing_rad[a, b])


@pytest.mark.parametrize("sigma_factor", [1e-6, 4.0])
def test_overlap_is_the_share_of_the_view_inside_the_other_one_widened_by_the_sigmas(sigma_factor: float) -> None:
    """Against points drawn from the field of view, which is uniform in range, bearing and elevation."""
    trip = make_round_trip(1)
    sequence, poses = replace(trip.sequence, vehicle_from_sonar=LEVER_ARM), trip.solution.bundle.world_from_vehicle
    found = search_loops(
        trip.solution, sequence, LoopsConfig(sigma_factor=sigma_factor, min_overlap=1e-6), WINDOW
    ).pairs
    covariance = sigma_factor**2 * joint_covariance(trip.solution.bundle, np.arange(30))
    sigma = predict_sigma(covariance, poses, LEVER_ARM, TYPICAL_RANGE_SHARE * SONAR.range_edges_m[-1])
    half = SONAR.elevation_aperture_rad / 2
    low = np.array([SONAR.range_edges_m[0], SONAR.bearing_edges_rad[0], -half])
    high = np.array([SONAR.range_edges_m[-1], SONAR.bearing_edges_rad[-1], half])
    drawn = back_project(*np.random.default_rng(0).uniform(low, high, (2000, 3)).T)
    errors = []
    for (a, b), pair in found.items():
        seen = np.stack(project(transform(invert(poses[b] @ LEVER_ARM) @ poses[a] @ LEVER_ARM, drawn)), axis=1)
        margin = np.array([sigma.range_m[a, b], sigma.bearing_rad[a, b], sigma.elevation_rad[a, b]])
        inside = ((seen >= low - margin) & (seen <= high + margin)).all(axis=1)
        errors.append(pair.overlap - inside.mean())
    assert np.max([pair.overlap for pair in found.values()]) > 0.5
    assert np.abs(np.mean(errors)) < 0.03 and np.std(errors) < 0.06


def _search_of(pairs: list[tuple[int, int, float]], count: int) -> LoopSearch:
    return LoopSearch(np.arange(count), {(a, b): LoopPair(a, b, share, 0.1, 0.01) for a, b, share in pairs})


@pytest.mark.parametrize("most", [1, 30, 1000])
def test_choice_is_bounded_and_evenly_spread(most: int) -> None:
    """The best pair of each cell, and the cells as small as the bound allows."""
    rng = np.random.default_rng(0)
    search = _search_of([(a, b, rng.random()) for a in range(50) for b in range(60, 110)], 110)
    chosen = choose_pairs(search, LoopsConfig(max_pairs=most), WINDOW)
    assert len(chosen) <= most
    assert len(chosen) >= (150 if most == 1000 else most / 2)
    assert max(pair.overlap for pair in search.pairs.values()) in [pair.overlap for pair in chosen]
    assert len({(pair.frame_a, pair.frame_b) for pair in chosen}) == len(chosen)
    if most == 30:
        for frames in ([pair.frame_a for pair in chosen], [pair.frame_b - 60 for pair in chosen]):
            assert min(frames) < 15 and max(frames) > 35
    assert chosen == choose_pairs(search, LoopsConfig(max_pairs=most), WINDOW)


def test_neighbours_are_the_pairs_just_before_and_after() -> None:
    search = _search_of(
        [(4, 30, 0.9), (3, 29, 0.5), (5, 31, 0.5), (6, 32, 0.5), (3, 31, 0.5), (5, 29, 0.5), (4, 31, 0.5)], 40
    )
    found = find_neighbours(search, search.pairs[4, 30])
    assert {(pair.frame_a, pair.frame_b) for pair in found} == {(3, 29), (5, 31), (3, 31), (5, 29)}
