"""Loop closure: drift is reduced, correlated observations count less, and without observations nothing moves."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from asfm.backend.graph.bundle_adjustment import Bundle
from asfm.backend.graph.problem import FIRST_POINT, FIRST_POSE
from asfm.backend.loops.loop_closure import close_loops
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import project
from asfm.types import FloatArray, Tracks
from tests.backend.loops.round_trip import SIGMA, make_round_trip
from tests.worlds import NO_TRACKS


def _error_m(poses: FloatArray, truth: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum((poses - truth)[:, :2, 3] ** 2, axis=1))))


def test_closing_a_loop_reduces_the_drift() -> None:
    """Over three round trips the horizontal position improves, most at the end.

    The height depends on elevations, which this motion hardly determines: a loop does not either.
    """
    at_end: list[list[float]] = []
    all_over: list[list[float]] = []
    for seed in range(3):
        trip = make_round_trip(seed)
        before = trip.solution.bundle.world_from_vehicle
        after = close_loops(trip.solution.bundle, trip.again, SIGMA, np.eye(4), 0.0)
        for errors, part in ((at_end, slice(-5, None)), (all_over, slice(None))):
            errors.append([_error_m(poses[part], trip.truth[part]) for poses in (before, after)])
    assert np.divide(*np.mean(at_end, axis=0)) > 2.0
    assert np.divide(*np.mean(all_over, axis=0)) > 1.4


def test_without_loop_observations_nothing_moves() -> None:
    trip = make_round_trip(0)
    after = close_loops(trip.solution.bundle, NO_TRACKS, SIGMA, np.eye(4), 0.0)
    assert after is trip.solution.bundle.world_from_vehicle


def test_landmarks_outside_the_graph_are_ignored() -> None:
    trip = make_round_trip(0)
    bundle = replace(trip.solution.bundle, in_graph=np.zeros(len(trip.solution.bundle.xyz_m), dtype=bool))
    assert close_loops(bundle, trip.again, SIGMA, np.eye(4), 0.0) is bundle.world_from_vehicle


def test_observations_that_fit_the_optimum_hardly_move_it() -> None:
    """Loop observations at the places where the optimum predicts them."""
    trip = make_round_trip(1)
    bundle = trip.solution.bundle
    points = transform(invert(bundle.world_from_vehicle)[trip.again.frame], bundle.xyz_m[trip.again.track])
    range_m, bearing_rad, _ = project(points)
    predicted = replace(trip.again, range_m=range_m, bearing_rad=bearing_rad)
    closed = close_loops(bundle, predicted, SIGMA, np.eye(4), 0.0)
    np.testing.assert_allclose(closed, bundle.world_from_vehicle, atol=0.02)


def test_correlation_counts_only_between_observations_of_one_track() -> None:
    trip = make_round_trip(0)
    first = np.unique(trip.again.track, return_index=True)[1]
    assert len(first) < len(trip.again)
    again = trip.again
    single = Tracks(again.track[first], again.frame[first], again.range_m[first], again.bearing_rad[first])
    for observations, same in ((single, True), (trip.again, False)):
        independent, correlated = (
            close_loops(trip.solution.bundle, observations, SIGMA, np.eye(4), rho) for rho in (0.0, 1.0)
        )
        assert np.array_equal(independent, correlated) == same


SIDEWAYS = make_pose(np.array([0.5, 0.0, 0.0]), Rotation.from_rotvec([0.0, 0.0, np.pi / 2]))
"""Mounting of a sonar that looks to port."""
FREE_M = 0.03
DISTANCE_M = 5.0


def _hold_all_but(axis: int) -> Bundle:
    """Make two poses at the origin that may move along one axis by FREE_M, and a fixed point abeam of the sonar."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    sigma = np.full(6, 1e-6)
    sigma[3 + axis] = FREE_M
    point_m = transform(SIDEWAYS, np.array([DISTANCE_M, 0.0, 0.0]))
    for key in (FIRST_POSE, FIRST_POSE + 1):
        graph.add(gtsam.PriorFactorPose3(key, gtsam.Pose3(), gtsam.noiseModel.Diagonal.Sigmas(sigma)))
        values.insert(key, gtsam.Pose3())
    graph.add(gtsam.PriorFactorPoint3(FIRST_POINT, point_m, gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)))
    values.insert(FIRST_POINT, point_m)
    nothing = gtsam.NonlinearFactorGraph()
    return Bundle(np.tile(np.eye(4), (2, 1, 1)), point_m[None], np.ones(1, dtype=bool), graph, nothing, values)


def _closest_m(error_m: float, sigma_m: float, correlation: float) -> float:
    """Return where a scalar prior of FREE_M and two passes of a Cauchy kernel of scale 2 put a vehicle."""
    at_m = 0.0
    for _ in range(2):
        inflated_m = max(1.0, abs(error_m - at_m) / sigma_m) * sigma_m * np.sqrt(1 + correlation)

        def cost(x_m: float, sigma_m: float = inflated_m) -> float:
            return float(x_m**2 / (2 * FREE_M**2) + 2 * np.log1p(((error_m - x_m) / sigma_m / 2) ** 2))

        at_m = float(minimize_scalar(cost, bounds=(-1, 1), options={"xatol": 1e-9}).x)
    return at_m


@pytest.mark.parametrize("correlation", [0.0, 1.0])
@pytest.mark.parametrize("error_sigmas", [0.1, 6.0])
def test_ranges_move_the_vehicle_as_far_as_their_own_sigma_says(error_sigmas: float, correlation: float) -> None:
    sigma = np.array([0.02, 0.005])
    range_m = np.full(2, DISTANCE_M - error_sigmas * sigma[0])
    again = Tracks(np.zeros(2, int), np.arange(2), range_m, np.zeros(2))
    moved_m = close_loops(_hold_all_but(1), again, sigma, SIDEWAYS, correlation)[:, 1, 3]
    expected_m = _closest_m(error_sigmas * sigma[0], sigma[0], correlation)
    np.testing.assert_allclose(moved_m, expected_m, rtol=0.02)


@pytest.mark.parametrize("correlation", [0.0, 1.0])
@pytest.mark.parametrize("error_sigmas", [0.1, 6.0])
def test_bearings_move_the_vehicle_as_far_as_their_own_sigma_says(error_sigmas: float, correlation: float) -> None:
    sigma = np.array([0.2, 0.005])
    again = Tracks(np.zeros(2, int), np.arange(2), np.full(2, DISTANCE_M), np.full(2, error_sigmas * sigma[1]))
    moved_m = close_loops(_hold_all_but(0), again, sigma, SIDEWAYS, correlation)[:, 0, 3]
    expected_m = _closest_m(error_sigmas * sigma[1] * DISTANCE_M, sigma[1] * DISTANCE_M, correlation)
    np.testing.assert_allclose(moved_m, expected_m, rtol=0.02)


def test_a_landmark_astern_is_as_good_as_one_ahead() -> None:
    """Bearings of a sonar that sees all around jump from pi to -pi astern."""
    turn, sigma = make_pose(np.zeros(3), Rotation.from_rotvec([0.0, 0.0, np.pi])), np.array([0.2, 0.005])
    moved_m = []
    for lever, bearing_rad in ((SIDEWAYS, 0.002), (SIDEWAYS @ turn, -np.pi + 0.002), (SIDEWAYS @ turn, np.pi + 0.002)):
        again = Tracks(np.zeros(2, int), np.arange(2), np.full(2, DISTANCE_M), np.full(2, bearing_rad))
        moved_m.append(close_loops(_hold_all_but(0), again, sigma, lever, 0.0)[:, 0, 3])
    np.testing.assert_allclose(moved_m[1:], [moved_m[0]] * 2, rtol=1e-3)
