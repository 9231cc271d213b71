"""Factors against their equations, written independently here, and Jacobians against finite differences."""

from collections.abc import Callable
from typing import Any

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.graph.factors import (
    attitude_factor,
    bearing_factor,
    depth_factor,
    elevation_factor,
    first_pose_factor,
    range_factor,
    sonar_from_beam,
    step_factor,
)
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import back_project, project
from asfm.types import FloatArray

POSE, POINT, NEXT = 0, 1, 2
LEVER_ARM = make_pose(np.array([0.4, -0.2, 0.15]), Rotation.from_euler("ZYX", [0.3, 0.5, -0.2]))
SEEDS = range(8)


def _random_pose(rng: np.random.Generator) -> FloatArray:
    return make_pose(rng.normal(0, 3, 3), Rotation.random(random_state=int(rng.integers(2**31))))


def _random_view(seed: int) -> tuple[FloatArray, FloatArray, float, float, float]:
    """A pose, a point that its sonar sees, and the point's range, bearing and elevation."""
    rng = np.random.default_rng(seed)
    world_from_vehicle = _random_pose(rng)
    range_m, bearing_rad, elevation_rad = rng.uniform([1, -0.8, -0.6], [9, 0.8, 0.6])
    seen = back_project(np.array(range_m), np.array(bearing_rad), float(elevation_rad))
    xyz_m = transform(world_from_vehicle @ LEVER_ARM, seen)
    return world_from_vehicle, xyz_m, float(range_m), float(bearing_rad), float(elevation_rad)


def _values(world_from_vehicle: FloatArray, xyz_m: FloatArray) -> gtsam.Values:
    values = gtsam.Values()
    values.insert(POSE, gtsam.Pose3(world_from_vehicle))
    values.insert(POINT, xyz_m)
    return values


def _error(factor: Any, values: gtsam.Values) -> FloatArray:
    """The factor's error in the units of its equation."""
    return np.asarray(factor.unwhitenedError(values), dtype=float)


def _check_jacobian(factor: gtsam.NonlinearFactor, values: gtsam.Values, sigmas: FloatArray) -> None:
    """Compare the linearised factor with central differences of its whitened error, in GTSAM's own tangent space."""
    sizes = {POSE: 6, POINT: 3, NEXT: 6}
    matrix, _ = factor.linearize(values).jacobian()
    keys = list(factor.keys())
    columns = []
    step = 1e-6
    for key in keys:
        for axis in range(sizes[key]):
            errors = []
            for sign in (1.0, -1.0):
                delta = gtsam.VectorValues()
                for other in keys:
                    delta.insert(other, sign * step * np.eye(6)[axis, : sizes[other]] * (other == key))
                errors.append(_error(factor, values.retract(delta)) / sigmas)
            columns.append((errors[0] - errors[1]) / (2 * step))
    numerical = np.stack(columns, axis=1)
    np.testing.assert_allclose(matrix, numerical, rtol=1e-4, atol=1e-6 * np.abs(numerical).max())


def _plain(factor: Any, sigmas: FloatArray) -> Any:
    """The same factor without its robust kernel, whose weight would scale the Jacobian."""
    return factor.cloneWithNewNoiseModel(gtsam.noiseModel.Diagonal.Sigmas(sigmas))


def test_beam_camera_is_a_rotation_that_looks_along_the_beam() -> None:
    for bearing_rad in (-2.0, -0.3, 0.0, 0.9):
        matrix = sonar_from_beam(bearing_rad).matrix()
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(matrix) == pytest.approx(1.0)
        np.testing.assert_allclose(matrix[:, 2], [np.cos(bearing_rad), np.sin(bearing_rad), 0], atol=1e-12)
        np.testing.assert_allclose(matrix[:, 1], [0, 0, 1], atol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_range_factor_is_the_distance_from_the_sonar(seed: int) -> None:
    world_from_vehicle, xyz_m, range_m, _, _ = _random_view(seed)
    factor = range_factor(POSE, POINT, range_m - 0.3, 0.05, gtsam.Pose3(LEVER_ARM))
    values = _values(world_from_vehicle, xyz_m)
    assert _error(factor, values) == pytest.approx(np.array([0.3]))
    _check_jacobian(_plain(factor, np.array([0.05])), values, np.array([0.05]))


@pytest.mark.parametrize("seed", SEEDS)
def test_bearing_factor_is_the_tangent_of_the_bearing_error(seed: int) -> None:
    world_from_vehicle, xyz_m, _, bearing_rad, elevation_rad = _random_view(seed)
    error_rad = 0.1 * (-1) ** seed
    factor = bearing_factor(POSE, POINT, bearing_rad - error_rad, 0.01, gtsam.Pose3(LEVER_ARM))
    values = _values(world_from_vehicle, xyz_m)
    expected = [np.tan(error_rad), np.tan(elevation_rad) / np.cos(error_rad)]
    np.testing.assert_allclose(_error(factor, values), expected, atol=1e-9)
    sigmas = np.array([0.01, 1.0])
    _check_jacobian(_plain(factor, sigmas), values, sigmas)


@pytest.mark.parametrize("elevation_rad", [-0.9, -0.5, 0.4, 0.8])
def test_bearing_factor_is_free_in_elevation_and_tight_in_bearing(elevation_rad: float) -> None:
    """Azimuths much smaller than the elevation, where GTSAM's bearing factors swap the two axes."""
    azimuth_rad = 0.05
    point = back_project(np.array(5.0), np.array(azimuth_rad), elevation_rad)
    factor = bearing_factor(POSE, POINT, azimuth_rad, 0.01, gtsam.Pose3())
    assert factor.error(_values(np.eye(4), point)) < 1e-3
    turned = back_project(np.array(5.0), np.array(azimuth_rad + 0.02), elevation_rad)
    assert factor.error(_values(np.eye(4), turned)) > 0.5
    for other_rad in (-0.7, 0.0, 0.7):  # next to no cost along the whole arc
        moved = back_project(np.array(5.0), np.array(azimuth_rad), other_rad)
        assert factor.error(_values(np.eye(4), moved)) < 1e-3


@pytest.mark.parametrize("seed", SEEDS)
def test_elevation_factor_constrains_the_elevation_alone(seed: int) -> None:
    world_from_vehicle, xyz_m, _, bearing_rad, elevation_rad = _random_view(seed)
    factor = elevation_factor(POSE, POINT, bearing_rad, elevation_rad - 0.2, 0.01, gtsam.Pose3(LEVER_ARM))
    values = _values(world_from_vehicle, xyz_m)
    expected = [0.0, np.tan(elevation_rad) - np.tan(elevation_rad - 0.2)]
    np.testing.assert_allclose(_error(factor, values), expected, atol=1e-9)
    _check_jacobian(factor, values, np.array([100.0, 0.01]))


@pytest.mark.parametrize("seed", SEEDS)
def test_depth_factor_constrains_the_height_alone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = _random_pose(rng)
    factor = depth_factor(POSE, float(pose[2, 3]) - 0.05, 0.02)
    values = _values(pose, np.zeros(3))
    assert abs(_error(factor, values)[2]) == pytest.approx(0.05)
    assert factor.error(values) == pytest.approx(0.5 * (0.05 / 0.02) ** 2, rel=1e-4)
    sideways = pose.copy()
    sideways[:2, 3] += rng.normal(0, 1e7, 2)
    assert factor.error(_values(sideways, np.zeros(3))) == pytest.approx(factor.error(values), rel=1e-9)
    _check_jacobian(factor, values, np.array([np.inf, np.inf, 0.02]))


@pytest.mark.parametrize("seed", SEEDS)
def test_first_pose_factor_weighs_errors_in_the_axes_of_the_world(seed: int) -> None:
    """A small rotation or shift along one axis of the world costs half the square of its size over its sigma."""
    rng = np.random.default_rng(seed)
    pose, sigma = _random_pose(rng), rng.uniform(0.01, 0.1, 6)
    factor = first_pose_factor(POSE, pose, sigma)
    assert factor.error(_values(pose, np.zeros(3))) < 1e-18
    for axis in range(3):
        turned, shifted = pose.copy(), pose.copy()
        turned[:3, :3] = Rotation.from_rotvec(1e-3 * np.eye(3)[axis]).as_matrix() @ pose[:3, :3]
        shifted[axis, 3] += 0.02
        for moved, size in ((turned, 1e-3 / sigma[axis]), (shifted, 0.02 / sigma[3 + axis])):
            assert factor.error(_values(moved, np.zeros(3))) == pytest.approx(size**2 / 2, rel=1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_attitude_factor_is_independent_of_yaw_and_position(seed: int) -> None:
    rng = np.random.default_rng(seed)
    roll_rad, pitch_rad = rng.uniform(-1.2, 1.2, 2).tolist()
    factor = attitude_factor(POSE, np.array([roll_rad, pitch_rad]), np.array([0.01, 0.02]), 0.3)
    for yaw_rad in rng.uniform(-np.pi, np.pi, 5).tolist():
        pose = make_pose(rng.normal(0, 5, 3), Rotation.from_euler("ZYX", [yaw_rad, pitch_rad, roll_rad]))
        assert factor.error(_values(pose, np.zeros(3))) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("off", [(0.004, 0.0), (0.0, 0.03), (0.004, -0.03)])
@pytest.mark.parametrize("yaw_rad", [-2.0, 0.0, 1.1, 3.0])
def test_attitude_factor_weights_roll_and_pitch_by_their_sigmas(off: tuple[float, float], yaw_rad: float) -> None:
    sigma = np.array([0.003, 0.02])
    factor = attitude_factor(POSE, np.array([0.3, -0.4]), sigma, yaw_rad)
    pose = make_pose(np.zeros(3), Rotation.from_euler("ZYX", [yaw_rad, -0.4 + off[1], 0.3 + off[0]]))
    expected = 0.5 * float(np.sum((np.array(off) / sigma) ** 2))
    assert factor.error(_values(pose, np.zeros(3))) == pytest.approx(expected, rel=0.03)


def test_attitude_factor_without_a_roll_leaves_it_free() -> None:
    factors = [attitude_factor(POSE, np.array([0.0, 0.2]), np.array([roll, 0.01]), 0.0) for roll in (np.inf, 0.01)]
    pose = make_pose(np.zeros(3), Rotation.from_euler("ZYX", [0.0, 0.2, 0.5]))
    free, held = (factor.error(_values(pose, np.zeros(3))) for factor in factors)
    assert free < 5 < 100 < held


def test_navigation_factors_are_robust_to_gross_errors() -> None:
    """The gradient at a hundred sigmas is that at three."""
    pose = _random_pose(np.random.default_rng(0))
    roll_rad, pitch_rad = 0.2, 0.1
    level = make_pose(np.zeros(3), Rotation.from_euler("ZYX", [0.0, pitch_rad, roll_rad]))
    depths = [depth_factor(POSE, float(pose[2, 3]) + off_m, 0.01) for off_m in (0.03, 1.0)]
    tilts = [
        attitude_factor(POSE, np.array([roll_rad, pitch_rad + off_rad]), np.full(2, 0.002), 0.0)
        for off_rad in (0.006, 0.35)
    ]
    for (near, far), at in ((depths, pose), (tilts, level)):
        pulls = [
            np.linalg.norm(
                f.linearize(_values(at, np.zeros(3))).jacobian()[0].T
                @ f.linearize(_values(at, np.zeros(3))).jacobian()[1]
            )
            for f in (near, far)
        ]
        assert pulls[1] < 1.2 * pulls[0]


@pytest.mark.parametrize("seed", SEEDS)
def test_step_factor_constrains_the_motion_between_poses(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, step = _random_pose(rng), _random_pose(rng)
    values = gtsam.Values()
    values.insert(POSE, gtsam.Pose3(first))
    values.insert(NEXT, gtsam.Pose3(first @ step))
    factor = step_factor(POSE, NEXT, step, 0.01, 0.02)
    np.testing.assert_allclose(_error(factor, values), np.zeros(6), atol=1e-9)
    _check_jacobian(factor, values, np.array([0.01] * 3 + [0.02] * 3))
    for offset, sigma in (((0.03, 0, 0, 0, 0, 0), 0.01), ((0, 0, 0, 0, 0.05, 0), 0.02)):
        moved = gtsam.Pose3(first @ step).retract(np.array(offset, dtype=float))
        values.update(NEXT, moved)
        assert factor.error(values) == pytest.approx(0.5 * (max(offset) / sigma) ** 2, rel=1e-6)


Make = Callable[[FloatArray], gtsam.NonlinearFactor]


@pytest.mark.parametrize(
    "make",
    [
        lambda seen: range_factor(POSE, POINT, float(project(seen)[0]), 0.01, gtsam.Pose3(LEVER_ARM)),
        lambda seen: bearing_factor(POSE, POINT, float(project(seen)[1]), 0.01, gtsam.Pose3(LEVER_ARM)),
    ],
    ids=["range", "bearing"],
)
def test_sonar_factors_are_robust_to_gross_errors(make: Make) -> None:
    """Cauchy kernel: ten times the error costs less than ten times as much, not a hundred times."""
    world_from_vehicle, xyz_m, range_m, bearing_rad, elevation_rad = _random_view(3)
    seen = transform(invert(world_from_vehicle @ LEVER_ARM), xyz_m)
    factor = make(seen)
    costs = []
    for share in (0.05, 0.5):
        wrong = back_project(np.array(range_m * (1 + share)), np.array(bearing_rad + share), elevation_rad)
        costs.append(factor.error(_values(world_from_vehicle, transform(world_from_vehicle @ LEVER_ARM, wrong))))
    assert 1 < costs[1] / costs[0] < 10


@pytest.mark.parametrize("sigmas", [0.5, 2.0, 6.0])
def test_sonar_factors_have_a_cauchy_kernel_that_halves_the_weight_at_two_sigmas(sigmas: float) -> None:
    """The cost is k^2 / 2 log(1 + (e / k)^2) with k = 2 sigmas; a Gaussian's is e^2 / 2."""
    point = back_project(np.array(5.0), np.zeros(1)[0], 0.0)
    values = _values(np.eye(4), point)
    expected = 2.0 * np.log(1 + (sigmas / 2.0) ** 2)
    of_range = range_factor(POSE, POINT, 5.0 - sigmas * 0.05, 0.05, gtsam.Pose3())
    assert of_range.error(values) == pytest.approx(expected)
    of_bearing = bearing_factor(POSE, POINT, -np.arctan(sigmas * 0.01), 0.01, gtsam.Pose3())
    assert of_bearing.error(values) == pytest.approx(expected)


@pytest.mark.parametrize("sigmas", [1.0, 2.9, 10.0])
def test_depth_has_a_huber_kernel_from_three_sigmas_on(sigmas: float) -> None:
    expected = sigmas**2 / 2 if sigmas < 3 else 3 * (sigmas - 1.5)
    factor = depth_factor(POSE, -sigmas * 0.02, 0.02)
    assert factor.error(_values(np.eye(4), np.zeros(3))) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("unmeasured", [0, 1])
def test_an_angle_that_is_not_measured_gets_hardly_any_information(unmeasured: int) -> None:
    sigma = np.where(np.arange(2) == unmeasured, np.inf, 0.01)
    values = gtsam.Values()
    values.insert(POSE, gtsam.Pose3(make_pose(np.zeros(3), Rotation.from_euler("z", 0.7))))
    information = attitude_factor(POSE, np.zeros(2), sigma, 0.7).linearize(values).information()
    assert information[1 - unmeasured, 1 - unmeasured] == pytest.approx(1e4, rel=1e-3)
    assert 0 < information[unmeasured, unmeasured] < 1e-3
