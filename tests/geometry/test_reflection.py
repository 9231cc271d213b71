"""Reflection at a sonar's x-y plane: range and bearing stay, elevation changes its sign."""

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.reflection import reflect, reflect_after, reflected_motion_jacobian, reflection_at
from asfm.geometry.sonar import project
from asfm.types import FloatArray

LEVER_ARM = make_pose(np.array([0.4, -0.1, -0.2]), Rotation.from_euler("ZYX", [0.1, 0.2, 0.0]))
FRAMES = 8


def make_poses() -> FloatArray:
    rng = np.random.default_rng(0)
    return make_pose(rng.normal(0, 0.5, (FRAMES, 3)), Rotation.from_rotvec(rng.normal(0, 0.3, (FRAMES, 3))))


def test_reflection_keeps_range_and_bearing_and_negates_elevation() -> None:
    poses, points = make_poses(), np.random.default_rng(1).uniform(-5, 5, (30, 3))
    image, mirrored = reflect(poses, points, LEVER_ARM)
    before = project(transform(invert(poses @ LEVER_ARM), points[:, None]))
    after = project(transform(invert(image @ LEVER_ARM), mirrored[:, None]))
    for one, other, sign in zip(before, after, (1, 1, -1), strict=True):
        np.testing.assert_allclose(other, sign * one, atol=1e-12)
    np.testing.assert_array_equal(image[0], poses[0])
    assert np.linalg.norm(image[-1] - poses[-1]) > 0.1


def test_reflecting_twice_gives_the_original() -> None:
    poses, points = make_poses(), np.random.default_rng(1).uniform(-5, 5, (30, 3))
    back, again = reflect(*reflect(poses, points, LEVER_ARM), LEVER_ARM)
    np.testing.assert_allclose(back, poses, atol=1e-12)
    np.testing.assert_allclose(again, points, atol=1e-12)


def test_reflected_poses_are_rigid() -> None:
    image, _ = reflect(make_poses(), np.zeros((0, 3)), LEVER_ARM)
    np.testing.assert_allclose(np.linalg.det(image[:, :3, :3]), 1.0)
    np.testing.assert_allclose(image[:, 3], np.tile([0.0, 0.0, 0.0, 1.0], (FRAMES, 1)), atol=1e-12)


@pytest.mark.parametrize("frame", [0, 3, FRAMES - 1])
def test_only_poses_after_the_frame_change(frame: int) -> None:
    poses = make_poses()
    image = reflect_after(poses, frame, LEVER_ARM)
    np.testing.assert_array_equal(image[: frame + 1], poses[: frame + 1])
    points = np.random.default_rng(2).uniform(-3, 3, (20, 3))
    mirrored = transform(reflection_at(poses[frame] @ LEVER_ARM), points)
    for index in range(frame + 1, FRAMES):
        before = project(transform(invert(poses[index] @ LEVER_ARM), points))
        after = project(transform(invert(image[index] @ LEVER_ARM), mirrored))
        np.testing.assert_allclose(after[0], before[0], atol=1e-12)
        np.testing.assert_allclose(after[1], before[1], atol=1e-12)
    np.testing.assert_allclose(reflect_after(image, frame, LEVER_ARM), poses, atol=1e-12)


@pytest.mark.parametrize("axis", range(6))
def test_motion_jacobian_is_the_derivative_of_the_reflected_pose(axis: int) -> None:
    """Central differences in GTSAM's tangent space."""
    poses, step = make_poses(), 1e-5
    jacobian = reflected_motion_jacobian(LEVER_ARM)
    image = gtsam.Pose3(reflect_after(poses, 0, LEVER_ARM)[5])
    ends = []
    for sign in (1, -1):
        moved = poses.copy()
        moved[5] = gtsam.Pose3(poses[5]).retract(sign * step * np.eye(6)[axis]).matrix()
        ends.append(image.localCoordinates(gtsam.Pose3(reflect_after(moved, 0, LEVER_ARM)[5])))
    np.testing.assert_allclose(jacobian[:, axis], (ends[0] - ends[1]) / (2 * step), atol=1e-6)
