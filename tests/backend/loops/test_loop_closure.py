"""Loop closure: drift is reduced, correlated observations count less, and without observations nothing moves."""

from dataclasses import replace

import numpy as np

from asfm.backend.loops.loop_closure import close_loops
from asfm.geometry.poses import invert, transform
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
