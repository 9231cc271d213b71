"""Joint covariance of poses against GTSAM's, and predicted sigmas against sampled poses."""

from functools import lru_cache

import gtsam
import numpy as np
from scipy.spatial.transform import Rotation

from asfm.backend.graph.bundle_adjustment import Bundle
from asfm.backend.graph.factors import bearing_factor, range_factor, step_factor
from asfm.backend.graph.problem import FIRST_POINT, FIRST_POSE
from asfm.backend.graph.relative_covariance import joint_covariance, predict_sigma
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import back_project, project

LEVER_ARM = make_pose(np.array([0.4, -0.1, -0.2]), Rotation.from_euler("ZYX", [0.1, 0.2, 0.0]))
FRAMES = np.array([0, 3, 7, 11])


@lru_cache(maxsize=1)
def make_bundle() -> Bundle:
    """Make a graph of odometry and sonar without noise, at its optimum. The last point has no observation."""
    rng = np.random.default_rng(0)
    swing = rng.uniform(-0.15, 0.15, (12, 6))
    swing[:, 1] += np.linspace(0, 2, 12)
    world_from_sonar = make_pose(swing[:, :3], Rotation.from_euler("ZYX", swing[:, 3:]))
    poses = world_from_sonar @ invert(LEVER_ARM)
    xyz_m = back_project(*rng.uniform([3, -0.5, -0.1], [8, 0.5, 0.1], (30, 3)).T) + np.array([0.0, 1.0, 0.0])
    graph, values, lever_arm = gtsam.NonlinearFactorGraph(), gtsam.Values(), gtsam.Pose3(LEVER_ARM)
    graph.add(gtsam.PriorFactorPose3(FIRST_POSE, gtsam.Pose3(poses[0]), gtsam.noiseModel.Isotropic.Sigma(6, 1e-4)))
    for index, pose in enumerate(poses):
        values.insert(FIRST_POSE + index, gtsam.Pose3(pose))
        if index:
            step = invert(poses[index - 1]) @ pose
            graph.add(step_factor(FIRST_POSE + index - 1, FIRST_POSE + index, step, 0.01, 0.03))
        range_m, bearing_rad, _ = project(transform(invert(world_from_sonar[index]), xyz_m))
        for point in range(index, index + 18):
            keys = FIRST_POSE + index, FIRST_POINT + point
            graph.add(range_factor(*keys, float(range_m[point]), 0.02, lever_arm))
            graph.add(bearing_factor(*keys, float(bearing_rad[point]), 0.01, lever_arm))
    for point in range(29):
        values.insert(FIRST_POINT + point, xyz_m[point])
        graph.add(gtsam.PriorFactorPoint3(FIRST_POINT + point, xyz_m[point], gtsam.noiseModel.Isotropic.Sigma(3, 0.5)))
    return Bundle(poses, xyz_m, np.arange(30) < 29, graph, graph, values)


def test_joint_covariance_is_that_of_gtsam() -> None:
    bundle = make_bundle()
    found = joint_covariance(bundle, FRAMES)
    marginals = gtsam.Marginals(bundle.graph, bundle.values)
    for i, first in enumerate(FRAMES.tolist()):
        np.testing.assert_allclose(found[i, i], marginals.marginalCovariance(FIRST_POSE + first), rtol=1e-3, atol=1e-9)
        for j, second in enumerate(FRAMES[:i].tolist()):
            both = marginals.jointMarginalCovariance([FIRST_POSE + second, FIRST_POSE + first])
            expected = both.at(FIRST_POSE + first, FIRST_POSE + second)
            np.testing.assert_allclose(found[i, j], expected, rtol=1e-3, atol=1e-9)


def test_predicted_sigmas_are_those_of_sampled_poses() -> None:
    """With poses sampled from the joint covariance, points ahead of the other frames scatter as predicted."""
    bundle, distance_m = make_bundle(), 5.0
    covariance = joint_covariance(bundle, FRAMES)
    poses = bundle.world_from_vehicle[FRAMES]
    found = predict_sigma(covariance, poses, LEVER_ARM, distance_m)
    full = covariance.transpose(0, 2, 1, 3).reshape(24, 24)
    drawn = np.random.default_rng(1).multivariate_normal(np.zeros(24), full, 4000).reshape(4000, 4, 6)
    disturbed = np.stack(
        [
            poses[index] @ make_pose(drawn[:, index, 3:], Rotation.from_rotvec(drawn[:, index, :3]))
            for index in range(4)
        ],
        axis=1,
    )
    ahead = transform(LEVER_ARM, np.array([distance_m, 0.0, 0.0]))
    for a in range(4):
        for b in range(4):
            seen = project(transform(invert(disturbed[:, b] @ LEVER_ARM), transform(disturbed[:, a], ahead)))
            for scatter, sigma in zip(seen, (found.range_m, found.bearing_rad, found.elevation_rad), strict=True):
                np.testing.assert_allclose(scatter.std(), sigma[a, b], rtol=0.06, atol=1e-6)


def test_predicted_sigmas_of_points_aside_and_above_are_those_of_sampled_poses() -> None:
    """The frames look apart: each sees the point ahead of the other far from the middle of its own beam.

    The stated sigma of a bearing is that of the shift across the beam over the range.
    """
    rng = np.random.default_rng(2)
    turned = Rotation.from_euler("ZYX", [[0.0, 0.0, 0.0], [-0.7, 0.5, 0.3]])
    poses = make_pose(np.array([[0.0, 0.0, 0.0], [0.5, 1.0, -0.5]]), turned)
    root = 0.005 * rng.normal(size=(12, 12)) * np.repeat([1, 0.1, 1, 0.1], 3)[:, None]
    covariance = (root @ root.T).reshape(2, 6, 2, 6).transpose(0, 2, 1, 3)
    found = predict_sigma(covariance, poses, LEVER_ARM, 5.0)
    drawn = rng.multivariate_normal(np.zeros(12), root @ root.T, 20000).reshape(-1, 2, 6)
    disturbed = poses @ make_pose(drawn[..., 3:], Rotation.from_rotvec(drawn[..., :3]))
    ahead = transform(LEVER_ARM, np.array([5.0, 0.0, 0.0]))
    for a, b in ((0, 1), (1, 0)):
        seen = project(transform(invert(disturbed[:, b] @ LEVER_ARM), transform(disturbed[:, a], ahead)))
        assert min(abs(np.mean(seen[1])), abs(np.mean(seen[2]))) > 0.2
        across = seen[0], seen[1] * np.cos(np.mean(seen[2])), seen[2]
        for scatter, sigma in zip(across, (found.range_m, found.bearing_rad, found.elevation_rad), strict=True):
            np.testing.assert_allclose(scatter.std(), sigma[a, b], rtol=0.03)


def test_uncertainty_grows_with_the_gap() -> None:
    found = predict_sigma(
        joint_covariance(make_bundle(), np.arange(12)), make_bundle().world_from_vehicle, LEVER_ARM, 5.0
    )
    assert (np.diff(found.range_m[0, [0, 2, 5, 9]]) > 0).all()
    assert found.range_m[4, 4] < 1e-6 and found.bearing_rad[4, 4] < 1e-6
