"""Calibration scores: one Newton step of the whole dense problem, which recovers a wrong calibration."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.diagnostics.calibration_parameters import NUMBER, PARAMETERS
from asfm.backend.diagnostics.calibration_scores import CalibrationScores, score_calibration
from asfm.backend.diagnostics.linearised_residuals import linearise_residuals
from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.schur_complement import marginalise_points
from asfm.geometry.poses import make_pose
from asfm.sequence import Sequence
from asfm.types import Trajectory
from tests.backend.diagnostics.solved import solve_vehicle, with_range_error
from tests.worlds import make_vehicle_sequence, observe_floor

STAMPS_S = make_vehicle_sequence().timestamps_s


def score(solution: Solution) -> CalibrationScores:
    return score_calibration(linearise_residuals(solution, STAMPS_S), marginalise_points(solution.bundle))


def estimate(solution: Solution, name: str) -> tuple[float, float]:
    value, sigma = score(solution).estimate([NUMBER[name]])
    return float(value[0]), float(sigma[0])


def scale_odometry(sequence: Sequence, factor: float) -> Sequence:
    assert sequence.odometry is not None
    poses = sequence.odometry.world_from_vehicle.copy()
    poses[:, :3, 3] = poses[0, :3, 3] + factor * (poses[:, :3, 3] - poses[0, :3, 3])
    return replace(sequence, odometry=Trajectory(sequence.odometry.timestamps_s, poses))


def delay_navigation(sequence: Sequence, delay_s: float) -> Sequence:
    assert sequence.navigation is not None
    late = replace(sequence.navigation, timestamps_s=sequence.navigation.timestamps_s + delay_s)
    return replace(sequence, navigation=late)


def turn_mounting(sequence: Sequence, axis: int, angle_rad: float) -> Sequence:
    """State a mounting from which the sonar is really turned by an angle."""
    turn = make_pose(np.zeros(3), Rotation.from_rotvec(-angle_rad * np.eye(3)[axis]))
    return replace(sequence, vehicle_from_sonar=sequence.vehicle_from_sonar @ turn)


def test_scores_are_those_of_the_dense_normal_equations() -> None:
    """Oracle: the information of all variables in one dense matrix, everything but the parameters eliminated."""
    solution = solve_vehicle()
    blocks, information = linearise_residuals(solution, STAMPS_S), marginalise_points(solution.bundle)
    found = score_calibration(blocks, information)
    gain = information.point_pose_gain.toarray()
    own = [information.points[i] for i in range(len(information.track))]
    points = np.zeros((3 * len(own), 3 * len(own)))
    for i, part in enumerate(own):
        points[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = part
    mixed = -points @ gain
    poses = information.poses.toarray() + gain.T @ points @ gain
    full = np.block([[poses, mixed.T], [mixed, points]])
    size, count = len(poses), blocks[0].by_parameter.shape[2]
    coupling = np.zeros((len(full), count))
    own_information = np.zeros((count, count))
    for block in blocks:
        for m in range(len(block.frame)):
            weighted = block.weight[m][:, None] * block.by_parameter[m]
            own_information += weighted.T @ block.by_parameter[m]
            for frame, derivative in block.by_pose:
                first = int(information.first_column[frame[m]])
                coupling[first : first + 6] += derivative[m].T @ weighted
            if block.track is not None and block.by_point is not None:
                at = size + 3 * int(np.searchsorted(information.track, block.track[m]))
                coupling[at : at + 3] += block.by_point[m].T @ weighted
    expected = own_information - coupling.T @ np.linalg.solve(full, coupling)
    expected += np.diag([parameter.prior_sigma**-2.0 for parameter in PARAMETERS])
    np.testing.assert_allclose(found.information, expected, rtol=1e-5, atol=1e-6 * np.abs(own_information).max())


def test_right_calibrations_score_within_their_noise() -> None:
    scores = score(solve_vehicle())
    for index in scores.observed.tolist():
        value, sigma = scores.estimate([index])
        assert abs(value[0]) < 4 * sigma[0], index


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_a_wrong_range_scale_is_estimated(factor: float) -> None:
    value, sigma = estimate(solve_vehicle(tracks=with_range_error(observe_floor(), factor)), "range_scale")
    assert value == pytest.approx(factor - 1, rel=0.6) and abs(value) > 2 * sigma


@pytest.mark.parametrize("factor", [0.7, 1.3])
def test_a_wrong_scale_of_the_odometry_is_estimated(factor: float) -> None:
    value, sigma = estimate(solve_vehicle(scale_odometry(make_vehicle_sequence(), factor)), "odometry_scale")
    assert np.sign(value) == np.sign(factor - 1) and abs(value) > 4 * sigma
    assert abs(value) == pytest.approx(abs(1 - factor), rel=0.5)


@pytest.mark.parametrize("delay_s", [-0.3, 0.3])
def test_late_depth_and_attitude_are_noticed(delay_s: float) -> None:
    value, sigma = estimate(solve_vehicle(delay_navigation(make_vehicle_sequence(), delay_s)), "navigation_delay")
    assert value == pytest.approx(delay_s, abs=0.15) and abs(value) > 4 * sigma


@pytest.mark.parametrize("angle_rad", [-0.05, 0.05])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_wrong_mounting_is_estimated(axis: int, angle_rad: float) -> None:
    name = ("mounting_roll", "mounting_pitch", "mounting_yaw")[axis]
    value, sigma = estimate(solve_vehicle(turn_mounting(make_vehicle_sequence(), axis, angle_rad)), name)
    assert np.sign(value) == np.sign(angle_rad) and abs(value) > sigma


def test_a_range_bias_and_an_odometry_scale_are_told_apart_together() -> None:
    tracks = with_range_error(observe_floor(), bias_m=0.4)
    scores = score(solve_vehicle(tracks=tracks))
    (bias_m, scale), _ = scores.estimate([NUMBER["range_bias"], NUMBER["odometry_scale"]])
    assert bias_m == pytest.approx(0.4, abs=0.12) and abs(scale) < 0.1
