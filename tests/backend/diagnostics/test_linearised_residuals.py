"""Linearised residuals: those of the graph, with derivatives that numerical differences confirm."""

from collections.abc import Callable
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.diagnostics.calibration_parameters import NUMBER
from asfm.backend.diagnostics.linearised_residuals import (
    ResidualBlock,
    linearise_depth_attitude,
    linearise_odometry,
    linearise_residuals,
    linearise_sonar,
)
from asfm.backend.estimation.solution import Solution
from asfm.geometry.poses import make_pose
from asfm.types import FloatArray
from tests.backend.diagnostics.solved import solve_vehicle, with_range_error
from tests.worlds import make_vehicle_sequence

STAMPS_S = make_vehicle_sequence().timestamps_s
EPSILON = 1e-6
BLOCKS: dict[str, Callable[[Solution], ResidualBlock]] = {
    "sonar": linearise_sonar,
    "odometry": lambda solution: linearise_odometry(solution, STAMPS_S),
    "depth and attitude": lambda solution: linearise_depth_attitude(solution, STAMPS_S),
}


@pytest.fixture(scope="module")
def solution() -> Solution:
    return solve_vehicle()


def with_poses(solution: Solution, poses: FloatArray) -> Solution:
    return replace(solution, bundle=replace(solution.bundle, world_from_vehicle=poses))


@pytest.mark.parametrize("sensor", BLOCKS)
def test_derivatives_by_the_poses_are_numerical_ones(solution: Solution, sensor: str) -> None:
    block, poses = BLOCKS[sensor](solution), solution.bundle.world_from_vehicle
    for axis in range(6):
        step = np.zeros(6)
        step[axis] = EPSILON
        moved = poses.copy()
        moved[7] = poses[7] @ gtsam.Pose3.Expmap(step).matrix()
        numerical = (BLOCKS[sensor](with_poses(solution, moved)).residual - block.residual) / EPSILON
        analytical = np.zeros_like(numerical)
        for frame, derivative in block.by_pose:
            analytical[frame == 7] += derivative[frame == 7, :, axis]
        scale = np.abs(numerical).max()
        np.testing.assert_allclose(analytical, numerical, atol=0.03 * scale)  # steps: the residual is small, not zero


def test_derivatives_by_the_points_are_numerical_ones(solution: Solution) -> None:
    block = linearise_sonar(solution)
    assert block.by_point is not None
    for axis in range(3):
        moved = solution.bundle.xyz_m.copy()
        moved[:, axis] += EPSILON
        found = linearise_sonar(replace(solution, bundle=replace(solution.bundle, xyz_m=moved)))
        numerical = (found.residual - block.residual) / EPSILON
        np.testing.assert_allclose(block.by_point[:, :, axis], numerical, rtol=1e-3, atol=1e-2)


def test_derivatives_by_the_mounting_are_numerical_ones(solution: Solution) -> None:
    block, mount = linearise_sonar(solution), solution.problem.vehicle_from_sonar
    changes = {
        f"mounting_{name}": mount @ make_pose(np.zeros(3), Rotation.from_rotvec(EPSILON * axis))
        for name, axis in zip(("roll", "pitch", "yaw"), np.eye(3), strict=True)
    }
    changes |= {
        f"lever_{name}": make_pose(EPSILON * axis, Rotation.identity()) @ mount
        for name, axis in zip("xyz", np.eye(3), strict=True)
    }
    for name, mounting in changes.items():
        problem = replace(solution.problem, vehicle_from_sonar=mounting)
        numerical = (linearise_sonar(replace(solution, problem=problem)).residual - block.residual) / EPSILON
        np.testing.assert_allclose(block.by_parameter[:, :, NUMBER[name]], numerical, rtol=1e-3, atol=1e-2)


def test_a_parameter_of_the_ranges_or_bearings_changes_them_alone(solution: Solution) -> None:
    """What is stated too long by a share is removed by a correction of that share."""
    block, tracks = linearise_sonar(solution), solution.tracks
    longer = replace(solution, tracks=with_range_error(tracks, bias_m=1e-4))
    np.testing.assert_allclose(
        linearise_sonar(longer).residual + 1e-4 * block.by_parameter[:, :, NUMBER["range_bias"]], block.residual
    )
    scaled = block.by_parameter[:, :, NUMBER["range_scale"]] * solution.problem.sigma
    np.testing.assert_allclose(scaled[:, 0], tracks.range_m, atol=0.1)
    bearings = block.by_parameter[:, :, NUMBER["bearing_scale"]] * solution.problem.sigma
    np.testing.assert_allclose(bearings[:, 1], tracks.bearing_rad, atol=0.05)
    assert not scaled[:, 1].any() and not bearings[:, 0].any()


@pytest.mark.parametrize("name", ["odometry_delay", "image_advance"])
def test_a_late_odometry_is_one_of_earlier_steps(solution: Solution, name: str) -> None:
    """The derivative by the delay is minus the rate at which the steps change: that of late steps is their change."""
    block = linearise_odometry(solution, STAMPS_S)
    derivative = block.by_parameter[:, :, NUMBER[name]]
    residual = linearise_odometry(_late_by(solution, 1), STAMPS_S).residual
    change = (residual - block.residual)[2:-2] / 0.2  # a frame is 0.2 s: predicted minus late steps
    ours = -derivative[2:-2]
    assert np.sum(ours * change) > 0.3 * np.sum(ours**2) > 0


def _late_by(solution: Solution, frames: int) -> Solution:
    sensors = solution.problem.sensors
    late = replace(sensors, steps=np.roll(sensors.steps, frames, axis=0))
    return replace(solution, problem=replace(solution.problem, sensors=late))


def test_residuals_are_those_of_the_graph() -> None:
    """Without the kernels, half the sum of squares is the error of GTSAM's factors (the prior's part aside)."""
    solution = solve_vehicle(navigation=False)
    blocks = linearise_residuals(solution, STAMPS_S)
    assert [block.sensor for block in blocks] == ["sonar", "odometry"]
    cost = 0.5 * float(np.sum(blocks[1].residual ** 2))
    cost += float(np.sum(2.0 * np.log1p((blocks[0].residual / 2.0) ** 2)))
    assert cost == pytest.approx(solution.bundle.measured.error(solution.bundle.values), rel=1e-3)


def test_what_was_not_measured_has_no_weight(solution: Solution) -> None:
    sensors = solution.problem.sensors
    sigma = sensors.z_roll_pitch_sigma.copy()
    sigma[3, 1] = np.inf
    without = replace(solution.problem, sensors=replace(sensors, z_roll_pitch_sigma=sigma))
    block = linearise_depth_attitude(replace(solution, problem=without), STAMPS_S)
    assert block.weight[3, 1] == 0 and np.count_nonzero(block.weight == 0) == 1
    assert np.isfinite(block.residual).all()
