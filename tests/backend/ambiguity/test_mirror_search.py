"""Search of partially mirrored solutions: the flip is found, a right solution has no better one."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.backend.ambiguity import mirror_search
from asfm.backend.ambiguity.mirror_search import (
    MIN_FRAMES_TO_END,
    _choose_tracks,
    _join,
    _Window,
    search_other_optima,
)
from asfm.backend.ambiguity.partial_mirroring import MIN_GAIN
from asfm.backend.estimation.solution import Solution, solve_tracks
from asfm.config_file import load_config
from asfm.geometry.poses import invert, steps_between
from asfm.geometry.reflection import reflect_after
from tests.oscillating_roll import FLIP, FRAMES, LEVER_ARM, make_case, make_motion, roll_rad


def solve(mirrored: bool) -> Solution:
    tracks, sequence, sensors, truth = make_case()
    start = reflect_after(truth, FLIP, LEVER_ARM) if mirrored else truth
    return solve_tracks(tracks, sequence, start, sensors, load_config())


def test_the_flip_is_found_and_relaxed_to_the_right_motion() -> None:
    best = search_other_optima(solve(mirrored=True))[0]
    truth = make_motion()
    found = roll_rad(best.world_from_sonar @ invert(LEVER_ARM))
    images = [roll_rad(truth), roll_rad(reflect_after(truth, 0, LEVER_ARM))]
    assert best.gain > 2 * MIN_GAIN
    assert min(np.abs(found - image).max() for image in images) < 0.1


def test_a_right_solution_has_no_better_one() -> None:
    found = search_other_optima(solve(mirrored=False))
    assert found[0].gain < MIN_GAIN
    assert [other.gain for other in found] == sorted((other.gain for other in found), reverse=True)


@pytest.mark.parametrize("reach", [FRAMES // 2, FRAMES])
def test_a_grid_of_moving_frames_is_tested_and_the_poses_as_they_are_where_all_fit(
    monkeypatch: pytest.MonkeyPatch, reach: int
) -> None:
    monkeypatch.setattr(mirror_search, "REACH", reach)
    solution = solve(mirrored=False)
    standstill = np.arange(FRAMES - 1) > MIN_FRAMES_TO_END + mirror_search.FRAME_STRIDE
    sensors = replace(solution.problem.sensors, standstill=standstill)
    found = search_other_optima(replace(solution, problem=replace(solution.problem, sensors=sensors)))
    tested = {other.frame for other in found}
    assert tested == {MIN_FRAMES_TO_END, MIN_FRAMES_TO_END + mirror_search.FRAME_STRIDE} | (
        {None} if reach >= FRAMES / 2 else set()
    )
    sensors = replace(sensors, standstill=np.ones(FRAMES - 1, dtype=bool))
    assert search_other_optima(replace(solution, problem=replace(solution.problem, sensors=sensors))) == []


def test_a_frame_is_tested_by_the_tracks_that_reach_farthest_to_both_sides(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mirror_search, "MAX_TRACKS", 6)
    solution = solve(mirrored=False)
    tracks = solution.tracks
    used, behind = _choose_tracks(solution, _Window.around(FLIP, FRAMES))
    both = np.array(
        [
            min(np.sum(tracks.frame[tracks.track == track] <= FLIP), np.sum(tracks.frame[tracks.track == track] > FLIP))
            for track in range(tracks.count)
        ]
    )
    chosen = np.unique(tracks.track[used])
    assert len(chosen) == 6 and both[chosen].min() >= np.sort(both)[-6]
    for track in range(tracks.count):
        after = tracks.frame[tracks.track == track] > FLIP
        assert behind[track] == (solution.bundle.in_graph[track] and after.sum() > (~after).sum())


def test_frames_behind_those_adjusted_keep_their_steps() -> None:
    poses = make_motion()
    adjusted = poses[5:12] @ LEVER_ARM
    joined = _join(poses, np.arange(5, 12), adjusted)
    np.testing.assert_array_equal(joined[:5], poses[:5])
    np.testing.assert_array_equal(joined[5:12], adjusted)
    expected = steps_between(poses)[11:]
    np.testing.assert_allclose(steps_between(joined)[12:], expected[1:], atol=1e-12)
    moved = adjusted[-1] @ invert(poses[11])
    np.testing.assert_allclose(joined[12:], moved @ poses[12:], atol=1e-12)
