"""Elevation-aperture constraints: violations, clamping to the edge, and priors that do not move the optimum."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.graph.aperture_bounds import (
    MAX_OUTSIDE_RAD,
    add_aperture_priors,
    add_elevation_factors,
    aperture_violations,
    clamp_to_aperture,
    middle_observations,
    observed_elevations,
)
from asfm.backend.graph.bundle_adjustment import make_values
from asfm.backend.graph.problem import FIRST_POINT, FIRST_POSE, BundleProblem
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import back_project, project
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.types import BoolArray, FloatArray, Tracks

HALF_APERTURE_RAD = 0.15
LEVER_ARM = make_pose(np.array([0.3, -0.1, 0.2]), Rotation.from_euler("ZYX", [0.2, 0.1, -0.1]))
FRAMES = 3


def make_poses() -> FloatArray:
    """(3, 4, 4): the frames differ in pitch, so that they see one point at different elevations."""
    angles = np.array([[0.0, -0.05, 0.0], [0.05, 0.0, 0.02], [-0.05, 0.05, 0.0]])
    return make_pose(np.array([[0.0, 0, 0], [0.1, 0, 0], [0.2, 0.1, 0]]), Rotation.from_euler("ZYX", angles))


def make_problem(elevation_rad: FloatArray) -> tuple[BundleProblem, FloatArray, FloatArray]:
    """Make points at (T,) elevations in the middle frame, all seen by all frames; with poses and points (T, 3)."""
    poses, count = make_poses(), len(elevation_rad)
    in_sonar = back_project(np.linspace(3, 6, count), np.linspace(-0.4, 0.4, count), elevation_rad)
    xyz_m = transform(poses[1] @ LEVER_ARM, in_sonar)
    track, frame = np.divmod(np.arange(count * FRAMES), FRAMES)
    range_m, bearing_rad, _ = project(transform(invert(poses @ LEVER_ARM)[frame], xyz_m[track]))
    sensors = SensorConstraints(
        poses[0],
        np.ones(6),
        True,
        invert(poses[:-1]) @ poses[1:],
        np.ones((FRAMES - 1, 2)),
        np.zeros((0, 3)),
        np.zeros((0, 3)),
    )
    observed = np.ones(len(track), dtype=bool)
    tracks = Tracks(track, frame, range_m, bearing_rad)
    problem = BundleProblem(tracks, observed, np.ones((len(track), 2)), sensors, LEVER_ARM, HALF_APERTURE_RAD)
    return problem, poses, xyz_m


def elevations_in(frame: int, poses: FloatArray, xyz_m: FloatArray) -> FloatArray:
    return project(transform(invert(poses[frame] @ LEVER_ARM), xyz_m))[2]


def select(problem: BundleProblem, *indices: int) -> BoolArray:
    return np.isin(np.arange(len(problem.tracks)), indices)


def test_elevations_are_those_in_the_frame_of_each_observation() -> None:
    given = np.array([-0.3, 0.0, 0.1, 0.4])
    problem, poses, xyz_m = make_problem(given)
    found = observed_elevations(problem, poses, xyz_m).reshape(-1, FRAMES)
    np.testing.assert_allclose(found[:, 1], given, atol=1e-12)
    for frame in range(FRAMES):
        np.testing.assert_allclose(found[:, frame], elevations_in(frame, poses, xyz_m), atol=1e-12)


def test_violations_are_used_observations_beyond_the_nearest_edge() -> None:
    problem, poses, xyz_m = make_problem(np.array([-0.3, 0.0, 0.3]))
    problem = replace(problem, observed=~select(problem, 1))
    outside, edge_rad = aperture_violations(problem, poses, xyz_m)
    assert outside.tolist() == [True, False, True, False, False, False, True, True, True]
    np.testing.assert_array_equal(edge_rad[outside], HALF_APERTURE_RAD * np.array([-1, -1, 1, 1, 1]))


def test_points_outside_are_moved_to_the_edge_where_they_are_farthest_outside() -> None:
    problem, poses, xyz_m = make_problem(np.array([-0.3, 0.0, 0.25]))
    clamped = clamp_to_aperture(problem, poses, xyz_m)
    np.testing.assert_array_equal(clamped[1], xyz_m[1])
    for track, sign in ((0, -1), (2, 1)):
        before = observed_elevations(problem, poses, xyz_m).reshape(-1, FRAMES)[track]
        worst = int(np.argmax(np.abs(before)))
        in_sonar = invert(poses[worst] @ LEVER_ARM)
        range_m, bearing_rad, _ = project(transform(in_sonar, xyz_m[track]))
        expected = [float(range_m), float(bearing_rad), sign * HALF_APERTURE_RAD]
        np.testing.assert_allclose(np.stack(project(transform(in_sonar, clamped[track]))), expected, atol=1e-12)


def test_points_seen_outside_only_by_unused_observations_are_not_moved() -> None:
    problem, poses, xyz_m = make_problem(np.array([0.3]))
    unused = replace(problem, observed=np.zeros(FRAMES, dtype=bool))
    np.testing.assert_array_equal(clamp_to_aperture(unused, poses, xyz_m), xyz_m)
    assert not aperture_violations(unused, poses, xyz_m)[0].any()


@pytest.mark.parametrize(
    ("observed", "expected"),
    [
        ([1, 1, 1, 1, 1, 1], [1, 4]),
        ([1, 0, 1, 0, 1, 1], [0, 4]),
        ([0, 0, 0, 0, 0, 1], [5]),
        ([0] * 6, []),
    ],
)
def test_one_middle_observation_is_selected_per_used_track(observed: list[int], expected: list[int]) -> None:
    problem, _, _ = make_problem(np.zeros(2))
    found = middle_observations(replace(problem, observed=np.array(observed, dtype=bool)))
    assert np.flatnonzero(found).tolist() == expected


def test_elevation_factors_connect_the_selected_poses_and_points() -> None:
    problem, poses, xyz_m = make_problem(np.array([0.0, 0.1]))
    graph = gtsam.NonlinearFactorGraph()
    selected = select(problem, 1, 5)
    at_estimate = observed_elevations(problem, poses, xyz_m)
    add_elevation_factors(graph, problem, selected, at_estimate + 0.02, 0.01)
    keys = [tuple(graph.at(index).keys()) for index in range(graph.size())]
    assert keys == [(FIRST_POSE + 1, FIRST_POINT), (FIRST_POSE + 2, FIRST_POINT + 1)]
    tangents = np.tan(at_estimate[selected]) - np.tan(at_estimate[selected] + 0.02)
    cost = graph.error(make_values(poses, xyz_m, np.ones(2, dtype=bool)))
    assert cost == pytest.approx(0.5 * float(np.sum((tangents / 0.01) ** 2)), rel=1e-9)


def test_aperture_priors_have_no_gradient_and_the_variance_of_a_uniform_elevation() -> None:
    problem, poses, xyz_m = make_problem(np.array([0.0, 0.05, -0.1]))
    graph = gtsam.NonlinearFactorGraph()
    add_aperture_priors(graph, problem, poses, xyz_m)
    assert graph.size() == len(xyz_m), "one a point, however many observations it has"
    values = make_values(poses, xyz_m, np.ones(3, dtype=bool))
    linear = graph.linearize(values)
    np.testing.assert_allclose(linear.hessian()[1], 0, atol=1e-9)
    last = FRAMES - 1
    range_m, bearing_rad, elevation_rad = project(transform(invert(poses[last] @ LEVER_ARM), xyz_m))
    for track in range(3):
        key = FIRST_POINT + track
        offset = 0.01
        in_sonar = back_project(range_m[track], bearing_rad[track], elevation_rad[track] + offset)
        moved = gtsam.Values(values)
        moved.update(key, transform(poses[last] @ LEVER_ARM, in_sonar))
        change = np.tan(elevation_rad[track] + offset) - np.tan(elevation_rad[track])
        assert graph.error(moved) == pytest.approx(0.5 * 3 * (change / HALF_APERTURE_RAD) ** 2, rel=1e-6)


def test_points_far_outside_get_a_position_prior_with_their_range_as_sigma() -> None:
    problem, poses, xyz_m = make_problem(np.array([0.0, HALF_APERTURE_RAD + MAX_OUTSIDE_RAD + 0.3]))
    graph = gtsam.NonlinearFactorGraph()
    add_aperture_priors(graph, problem, poses, xyz_m)
    priors = [graph.at(index) for index in range(graph.size()) if len(graph.at(index).keys()) == 1]
    assert [list(prior.keys()) for prior in priors] == [[FIRST_POINT + 1]]
    values = make_values(poses, xyz_m, np.ones(2, dtype=bool))
    assert graph.error(values) == pytest.approx(0.0, abs=1e-12)
    moved = gtsam.Values(values)
    moved.update(FIRST_POINT + 1, xyz_m[1] + np.array([0.0, 0.6, 0.0]))
    assert priors[0].error(moved) == pytest.approx(0.5 * (0.6 / problem.tracks.range_m[-1]) ** 2)


def test_points_a_little_outside_get_a_prior_of_their_elevation_alone() -> None:
    problem, poses, xyz_m = make_problem(np.array([0.0, HALF_APERTURE_RAD + MAX_OUTSIDE_RAD / 2]))
    graph = gtsam.NonlinearFactorGraph()
    add_aperture_priors(graph, problem, poses, xyz_m)
    assert [len(graph.at(index).keys()) for index in range(graph.size())] == [2, 2]
