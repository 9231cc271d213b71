"""Convention test: wrong signs and exchanged axes of depth and attitude are named, right ones are not."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.backend.diagnostics.reading_conventions import (
    CONVENTIONS,
    compare_stretch,
    convert_readings,
    diagnose_conventions,
)
from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.bundle_adjustment import adjust_bundle
from asfm.geometry.poses import depth_roll_pitch, invert, transform
from tests.backend.diagnostics.solved import solve_vehicle
from tests.worlds import make_vehicle_sequence, observe_floor

STAMPS_S = make_vehicle_sequence().timestamps_s
NAMED = {item.name: item for item in CONVENTIONS}


def drop_odometry(solution: Solution) -> Solution:
    """Put a weak motion prior in the place of the odometry."""
    sensors = solution.problem.sensors
    still, sigma = np.repeat(np.eye(4)[None], len(sensors.steps), axis=0), np.tile([0.2, 0.3], (len(sensors.steps), 1))
    sensors = replace(sensors, measured=False, steps=still, step_sigma=sigma)
    return replace(solution, problem=replace(solution.problem, sensors=sensors))


def solve_again(solution: Solution) -> Solution:
    bundle = adjust_bundle(solution.problem, solution.bundle.world_from_vehicle, solution.bundle.xyz_m)
    return replace(solution, bundle=bundle)


@pytest.fixture(scope="module")
def right() -> Solution:
    tracks = observe_floor()
    return solve_again(drop_odometry(solve_vehicle(tracks=tracks.select(tracks.track % 2 == 0))))


def record(right: Solution, name: str) -> Solution:
    """Solve the world as it is where the readings are recorded in another convention."""
    return solve_again(convert_readings(right, np.linalg.inv(NAMED[name].from_recorded).astype(np.float64)))


def test_right_readings_are_not_questioned(right: Solution) -> None:
    assert diagnose_conventions(right, STAMPS_S) == ()


def test_marine_readings_are_named(right: Solution) -> None:
    name = "z_m and pitch_rad negated (NED/FRD)"
    (found,) = diagnose_conventions(record(right, name), STAMPS_S)
    assert found.code == "navigation-convention" and name in found.message


@pytest.mark.parametrize("name", ["z_m negated (a depth)", "roll_rad and pitch_rad exchanged"])
def test_a_stretch_fits_better_with_the_right_convention(name: str, right: Solution) -> None:
    increase = compare_stretch(record(right, name), STAMPS_S, [NAMED[name]])
    assert increase[name] < -10
    assert compare_stretch(right, STAMPS_S, [NAMED[name]])[name] > 10


def test_nothing_is_said_with_odometry_or_without_readings(right: Solution) -> None:
    for changed in (
        replace(right.problem.sensors, measured=True),
        replace(right.problem.sensors, z_roll_pitch=np.zeros((0, 3)), z_roll_pitch_sigma=np.zeros((0, 3))),
    ):
        assert diagnose_conventions(replace(right, problem=replace(right.problem, sensors=changed)), STAMPS_S) == ()


def test_poses_are_those_that_converted_readings_state_and_points_keep_their_place(right: Solution) -> None:
    matrix = NAMED["roll_rad and pitch_rad exchanged"].from_recorded
    found = convert_readings(right, matrix)
    stated = right.problem.sensors.z_roll_pitch @ matrix.T
    np.testing.assert_allclose(depth_roll_pitch(found.bundle.world_from_vehicle), stated, atol=1e-9)
    np.testing.assert_array_equal(found.problem.sensors.first_pose, found.bundle.world_from_vehicle[0])
    tracks = right.tracks
    local = [
        transform(invert(s.bundle.world_from_vehicle)[tracks.frame], s.bundle.xyz_m[tracks.track])
        for s in (right, found)
    ]
    same = np.isclose(local[0], local[1], atol=1e-9).all(axis=1)
    assert set(tracks.track[same].tolist()) == set(range(tracks.count))


def test_conventions_differ_from_each_other_and_from_each_mirror_image() -> None:
    matrices = [sign * item.from_recorded for item in CONVENTIONS for sign in (1, -1)] + [np.eye(3), -np.eye(3)]
    assert len({tuple(matrix.ravel()) for matrix in matrices}) == len(matrices)
