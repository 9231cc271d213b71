"""Stretch of a solution: frames where the readings vary, and their own observations with the same points."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.backend.diagnostics.solution_stretch import MIN_VIEWS, STRETCH_FRAMES, choose_stretch, select_stretch
from asfm.backend.estimation.solution import Solution
from tests.backend.diagnostics.solved import solve_vehicle


@pytest.fixture(scope="module")
def solved() -> Solution:
    return solve_vehicle()


def with_readings(solution: Solution, z_roll_pitch: np.ndarray) -> Solution:
    sensors = replace(solution.problem.sensors, z_roll_pitch=z_roll_pitch)
    return replace(solution, problem=replace(solution.problem, sensors=sensors))


def test_the_stretch_covers_the_frames_that_vary(solved: Solution) -> None:
    count = len(solved.bundle.world_from_vehicle)
    readings = np.zeros((count, 3))
    readings[count - 6 :, 1] = np.linspace(0, 1, 6)
    first, last = choose_stretch(with_readings(solved, readings))
    assert last - first + 1 == min(STRETCH_FRAMES, count) and last == count - 1


def test_observations_keep_their_frames_points_and_sigmas(solved: Solution) -> None:
    first, last = 3, 14
    part = select_stretch(solved, first, last)
    assert part.tracks.count == len(part.bundle.xyz_m) and len(part.problem.sigma) == len(part.tracks)
    assert np.bincount(part.tracks.track).min() >= MIN_VIEWS
    assert part.tracks.frame.min() >= 0 and part.tracks.frame.max() <= last - first
    whole = {
        (int(f), float(r)): solved.bundle.xyz_m[t]
        for f, r, t in zip(solved.tracks.frame, solved.tracks.range_m, solved.tracks.track, strict=True)
    }
    for frame, range_m, track in zip(part.tracks.frame, part.tracks.range_m, part.tracks.track, strict=True):
        np.testing.assert_array_equal(whole[int(frame) + first, float(range_m)], part.bundle.xyz_m[track])
    sensors, before = part.problem.sensors, solved.problem.sensors
    np.testing.assert_array_equal(sensors.z_roll_pitch, before.z_roll_pitch[first : last + 1])
    np.testing.assert_array_equal(sensors.steps, before.steps[first:last])
