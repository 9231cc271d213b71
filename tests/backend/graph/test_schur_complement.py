"""Schur complement against the inverse of the dense information matrix, which marginalises by itself."""

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.graph.bundle_adjustment import Bundle
from asfm.backend.graph.factors import bearing_factor, range_factor, step_factor
from asfm.backend.graph.problem import FIRST_POINT, FIRST_POSE
from asfm.backend.graph.schur_complement import PoseInformation, marginalise_points, point_information
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import back_project, project
from asfm.types import FloatArray, IntArray

FRAMES, POINTS = 5, 9
UNSEEN = 4
"""A track without a factor: the columns of the points after it move up."""
RANGE_BIAS = gtsam.symbol("b", 0)
"""Another variable that is neither pose nor point; its key sorts before both."""


def make_bundle(extra: bool = False) -> Bundle:
    """Make a graph of steps, ranges, bearings and point priors at random places, on request with a scalar variable."""
    rng = np.random.default_rng(3)
    poses = make_pose(rng.normal(0, 0.3, (FRAMES, 3)), Rotation.from_rotvec(rng.normal(0, 0.1, (FRAMES, 3))))
    xyz_m = back_project(*rng.uniform([3, -0.5, -0.1], [8, 0.5, 0.1], (POINTS, 3)).T)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorPose3(FIRST_POSE, gtsam.Pose3(poses[0]), gtsam.noiseModel.Isotropic.Sigma(6, 0.01)))
    for frame, pose in enumerate(poses):
        values.insert(FIRST_POSE + frame, gtsam.Pose3(pose))
        if frame:
            step = invert(poses[frame - 1]) @ pose
            graph.add(step_factor(FIRST_POSE + frame - 1, FIRST_POSE + frame, step, 0.02, 0.05))
    in_graph = np.arange(POINTS) != UNSEEN
    for track in np.flatnonzero(in_graph).tolist():
        values.insert(FIRST_POINT + track, xyz_m[track])
        prior = gtsam.noiseModel.Isotropic.Sigma(3, 0.3)
        graph.add(gtsam.PriorFactorPoint3(FIRST_POINT + track, xyz_m[track] + 0.1, prior))
        for frame in range(track % 2, FRAMES):
            range_m, bearing_rad, _ = project(transform(invert(poses[frame]), xyz_m[track]))
            keys = FIRST_POSE + frame, FIRST_POINT + track
            graph.add(range_factor(*keys, float(range_m) + 0.01, 0.02, gtsam.Pose3()))
            graph.add(bearing_factor(*keys, float(bearing_rad) - 0.004, 0.01, gtsam.Pose3()))
    if extra:
        values.insert(RANGE_BIAS, 0.1)
        graph.add(gtsam.PriorFactorDouble(RANGE_BIAS, 0.0, gtsam.noiseModel.Isotropic.Sigma(1, 0.5)))
    return Bundle(poses, xyz_m, in_graph, graph, graph, values)


def dense_information(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> tuple[FloatArray, IntArray]:
    """Return GTSAM's dense information matrix, points last, and the number of columns that are no points."""
    keys = sorted(graph.linearize(values).keyVector())
    order = [key for key in keys if not FIRST_POINT <= key < FIRST_POINT + POINTS]
    others = sum(len(values.zeroVectors().at(key)) for key in order)
    ordering = gtsam.Ordering()
    for key in order + [key for key in keys if key not in order]:
        ordering.push_back(key)
    information, _ = graph.linearize(values).hessian(ordering)
    return np.asarray(information), np.arange(others)


Case = tuple[Bundle, PoseInformation, FloatArray, IntArray]
"""A bundle, what is tested, GTSAM's dense information with the points last, and its columns that are no points."""


@pytest.fixture(scope="module", params=[False, True], ids=["poses-and-points", "with-another-variable"])
def case(request: pytest.FixtureRequest) -> Case:
    bundle = make_bundle(extra=request.param)
    return bundle, marginalise_points(bundle), *dense_information(bundle.graph, bundle.values)


def test_pose_covariance_is_that_of_the_dense_inverse(case: Case) -> None:
    _, found, dense, others = case
    expected = np.linalg.inv(dense)[np.ix_(others, others)]
    np.testing.assert_allclose(np.linalg.inv(found.poses.toarray()), expected, atol=1e-5 * np.abs(expected).max())


def test_point_covariance_follows_from_its_own_information_and_the_gain(case: Case) -> None:
    """Block inversion: H_pp^-1 + G C G'."""
    bundle, found, dense, others = case
    assert found.track.tolist() == np.flatnonzero(bundle.in_graph).tolist()
    expected = np.linalg.inv(dense)[len(others) :, len(others) :]
    gain = found.point_pose_gain.toarray()
    through_poses = gain @ np.linalg.inv(found.poses.toarray()) @ gain.T
    for index in range(len(found.track)):
        block = np.s_[3 * index : 3 * index + 3]
        covariance = np.linalg.inv(found.points[index]) + through_poses[block, block]
        np.testing.assert_allclose(covariance, expected[block, block], atol=1e-5 * np.abs(expected).max())


def test_gain_moves_points_to_their_optimum_when_poses_move(case: Case) -> None:
    """Minimise the quadratic cost over the points with the poses displaced, by a dense solve."""
    _, found, dense, others = case
    displaced = np.random.default_rng(0).normal(0, 1e-2, len(others))
    points = dense[len(others) :, len(others) :]
    expected = np.linalg.solve(points, -dense[len(others) :, : len(others)] @ displaced)
    np.testing.assert_allclose(found.point_pose_gain @ displaced, expected, atol=1e-6)


def test_columns_of_poses_are_where_stated(case: Case) -> None:
    """Rows of the covariance at a pose's columns are GTSAM's marginal covariance of it."""
    bundle, found, _, _ = case
    covariance = np.linalg.inv(found.poses.toarray())
    marginals = gtsam.Marginals(bundle.graph, bundle.values)
    assert len(found.first_column) == FRAMES
    for frame, first in enumerate(found.first_column.tolist()):
        expected = marginals.marginalCovariance(FIRST_POSE + frame)
        block = covariance[first : first + 6, first : first + 6]
        np.testing.assert_allclose(block, expected, atol=1e-5 * np.abs(expected).max())


def test_point_information_is_the_block_of_the_dense_matrix_for_the_chosen_tracks(case: Case) -> None:
    bundle, found, dense, others = case
    chosen = np.array([1, 5, 8])
    information = point_information(bundle.graph, bundle.values, chosen)
    for track, block in zip(chosen.tolist(), information, strict=True):
        first = len(others) + 3 * found.track.tolist().index(track)
        np.testing.assert_allclose(block, dense[first : first + 3, first : first + 3], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(block, found.points[found.track == track][0], rtol=1e-6, atol=1e-6)


def test_a_point_with_one_range_is_invertible_and_adds_no_information_on_the_pose() -> None:
    """The point's own information has rank one."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorPose3(FIRST_POSE, gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, 0.1)))
    graph.add(range_factor(FIRST_POSE, FIRST_POINT, 5.0, 0.02, gtsam.Pose3()))
    values.insert(FIRST_POSE, gtsam.Pose3())
    values.insert(FIRST_POINT, np.array([5.0, 0.0, 0.0]))
    poses, points = np.eye(4)[None], np.array([[5.0, 0.0, 0.0]])
    found = marginalise_points(Bundle(poses, points, np.ones(1, dtype=bool), graph, graph, values))
    assert np.linalg.matrix_rank(found.points[0] - found.points[0][1, 1] * np.eye(3)) == 1
    np.testing.assert_allclose(found.poses.toarray(), 100 * np.eye(6), atol=1e-3)


def test_a_graph_without_points_is_left_as_it_is() -> None:
    bundle = make_bundle()
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for index in range(FRAMES):
        graph.add(bundle.graph.at(index))
        values.insert(FIRST_POSE + index, gtsam.Pose3(bundle.world_from_vehicle[index]))
    none = np.zeros((0, 3)), np.zeros(0, dtype=bool)
    found = marginalise_points(Bundle(bundle.world_from_vehicle, *none, graph, graph, values))
    expected, _ = graph.linearize(values).hessian()
    np.testing.assert_allclose(found.poses.toarray(), expected, rtol=1e-6, atol=1e-4)
    assert found.points.shape == (0, 3, 3) and found.point_pose_gain.shape == (0, 6 * FRAMES)


def test_information_is_invertible_where_nothing_holds_the_poses() -> None:
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(step_factor(FIRST_POSE, FIRST_POSE + 1, np.eye(4), 0.01, 0.02))
    for frame in range(2):
        values.insert(FIRST_POSE + frame, gtsam.Pose3())
    none = np.zeros((0, 3)), np.zeros(0, dtype=bool)
    found = marginalise_points(Bundle(np.tile(np.eye(4), (2, 1, 1)), *none, graph, graph, values)).poses.toarray()
    assert np.linalg.eigvalsh(found)[0] > 1e-7
    step = np.hstack([-np.eye(6), np.eye(6)])
    sigma = np.sqrt(np.diag(step @ np.linalg.inv(found) @ step.T))
    np.testing.assert_allclose(sigma, [0.01] * 3 + [0.02] * 3, rtol=1e-3)
