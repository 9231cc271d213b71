"""Marginal covariances against GTSAM's, and with more information on elevations."""

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.graph.bundle_adjustment import Bundle, adjust_bundle
from asfm.backend.graph.marginal_covariance import FRAMES_PER_BLOCK, measure_uncertainty
from asfm.backend.graph.problem import FIRST_POINT, FIRST_POSE, BundleProblem
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, project
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.sequence import Sequence
from asfm.types import FloatArray, IntArray, Tracks
from tests.worlds import make_constraints, no_frame

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (500, 128), np.deg2rad(20))
LEVER_ARM = make_pose(np.array([0.4, -0.1, -0.2]), Rotation.from_euler("ZYX", [0.1, 0.2, 0.0]))
FRAMES = FRAMES_PER_BLOCK + 6
"""More than one block."""


@pytest.fixture(scope="module")
def bundle() -> Bundle:
    rng = np.random.default_rng(4)
    along = np.arange(FRAMES)
    poses = make_poses(along)
    points = rng.uniform([3.0, -2.0, -0.8], [6.0, 4.0, 0.8], (25, 3))
    seen = transform(invert(poses @ LEVER_ARM), points[:, None])
    track, frame = np.nonzero(SONAR.sees(seen))
    range_m, bearing_rad, _ = project(seen[track, frame])
    sigma = np.array([0.01, 0.005])
    error = rng.normal(0, sigma, (len(track), 2))
    tracks = Tracks(track, frame, range_m + error[:, 0], bearing_rad + error[:, 1])
    sequence = Sequence("made up", SONAR, along.astype(float), no_frame, LEVER_ARM)
    steps = np.tile([0.003, 0.02], (FRAMES - 1, 1))
    sensors: SensorConstraints = make_constraints(sequence, poses, steps, measured=True)
    observed = np.ones(len(tracks), dtype=bool)
    problem = BundleProblem(
        tracks, observed, np.tile(sigma, (len(tracks), 1)), sensors, LEVER_ARM, SONAR.elevation_aperture_rad / 2
    )
    return adjust_bundle(problem, poses, points)


def make_poses(
    along: IntArray,
) -> FloatArray:
    turns = Rotation.from_euler(
        "ZYX", np.stack([0.2 * np.sin(along / 9), 0.1 * np.sin(along / 5), 0.3 * np.sin(along / 4)], 1)
    )
    poses = np.repeat(np.eye(4)[None], len(along), axis=0)
    poses[:, :3, :3] = turns.as_matrix()
    poses[:, :3, 3] = np.stack([0.01 * along, 0.03 * along, 0.1 * np.sin(along / 6)], axis=1)
    return poses


def test_covariances_of_poses_and_points_are_those_of_gtsam(bundle: Bundle) -> None:
    found = measure_uncertainty(bundle, np.ones(len(bundle.xyz_m)))
    marginals = gtsam.Marginals(bundle.graph, bundle.values)
    for index in (0, 1, 30, FRAMES_PER_BLOCK, FRAMES - 1):
        expected = marginals.marginalCovariance(FIRST_POSE + index)
        np.testing.assert_allclose(found.pose[index], expected, atol=1e-4 * np.abs(expected).max())
    assert bundle.in_graph.sum() > 15
    for index in np.flatnonzero(bundle.in_graph).tolist():
        expected = marginals.marginalCovariance(FIRST_POINT + index)
        np.testing.assert_allclose(found.point_m2[index], expected, atol=1e-4 * np.abs(expected).max())
    assert np.isinf(found.point_m2[~bundle.in_graph]).all()


@pytest.mark.parametrize("span", [1, 10, FRAMES - 1])
def test_covariances_of_motions_over_a_span_are_those_of_gtsam(bundle: Bundle, span: int) -> None:
    found = measure_uncertainty(bundle, np.ones(len(bundle.xyz_m)), span)
    assert found.span.shape == (FRAMES - span, 6, 6)
    marginals = gtsam.Marginals(bundle.graph, bundle.values)
    for first in {0, (FRAMES - span) // 2, FRAMES - span - 1}:
        keys = gtsam.KeyVector([FIRST_POSE + first, FIRST_POSE + first + span])
        both = marginals.jointMarginalCovariance(keys).fullMatrix()
        a, b = (gtsam.Pose3(bundle.world_from_vehicle[index]) for index in (first, first + span))
        change = np.hstack([-b.between(a).AdjointMap(), np.eye(6)])
        expected = change @ both @ change.T
        np.testing.assert_allclose(found.span[first], expected, atol=1e-4 * np.abs(expected).max())


def test_elevation_information_reduces_point_covariances_and_not_those_of_poses(bundle: Bundle) -> None:
    count = len(bundle.xyz_m)
    plain, informed = (
        measure_uncertainty(bundle, np.full(count, elevation_information_ratio))
        for elevation_information_ratio in (1.0, 4.0)
    )
    np.testing.assert_array_equal(plain.pose, informed.pose)
    gained = plain.point_m2[bundle.in_graph] - informed.point_m2[bundle.in_graph]
    assert (np.linalg.eigvalsh(gained) > -1e-12).all() and (np.trace(gained, axis1=1, axis2=2) > 0).all()
    assert (np.linalg.eigvalsh(informed.point_m2[bundle.in_graph]) > 0).all()
