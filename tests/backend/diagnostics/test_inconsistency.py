"""Inconsistency: measurements that contradict the result are named with numbers, and right ones are not."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.backend.diagnostics.inconsistency import (
    measure_consistency,
    measure_used_share,
    warn_of_inconsistency,
    withdraw_well_constrained,
)
from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.schur_complement import marginalise_points
from asfm.consistency import CalibrationScore, Consistency, ResidualStatistics
from asfm.sequence import Sequence
from tests.backend.diagnostics.solved import solve_vehicle, with_range_error
from tests.worlds import make_landmarks, make_vehicle_sequence, observe_floor


def measure(solution: Solution) -> Consistency:
    stamps_s = make_vehicle_sequence().timestamps_s
    return measure_consistency(solution, stamps_s, marginalise_points(solution.bundle), 40)


def with_attitude_in_degrees(sequence: Sequence) -> Sequence:
    assert sequence.navigation is not None
    factor = float(np.rad2deg(1.0))
    roll_rad, pitch_rad = factor * sequence.navigation.roll_rad, factor * sequence.navigation.pitch_rad
    return replace(sequence, navigation=replace(sequence.navigation, roll_rad=roll_rad, pitch_rad=pitch_rad))


def statistics(sensor: str, bad: bool) -> ResidualStatistics:
    return ResidualStatistics(sensor, 1.4, 9.0, 2.0, (3, 12), ((3, 14),) if bad else ())


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("navigation", [True, False])
def test_right_measurements_are_consistent(seed: int, navigation: bool) -> None:
    found = measure(solve_vehicle(make_vehicle_sequence(seed), observe_floor(seed), navigation))
    assert warn_of_inconsistency(found) == ()
    landmarks = make_landmarks(5, 2)
    assert withdraw_well_constrained(landmarks, found).well_constrained.sum() == 2
    sensors = {item.sensor for item in found.residuals}
    assert {"sonar range", "odometry rotation"} <= sensors and ("depth" in sensors) == navigation


def test_without_odometry_only_the_readings_are_examined() -> None:
    """The motion prior prefers a small world: it would be taken for ranges that are too long."""
    solution = solve_vehicle()
    sensors = replace(solution.problem.sensors, measured=False)
    found = measure(replace(solution, problem=replace(solution.problem, sensors=sensors)))
    assert {item.parameter for item in found.calibration} == {"depth_scale", "navigation_delay"}


def test_what_another_test_contradicts_is_not_well_constrained() -> None:
    assert not withdraw_well_constrained(make_landmarks(5, 2), Consistency(), True).well_constrained.any()


def test_attitude_in_degrees_contradicts_the_result() -> None:
    found = measure(solve_vehicle(with_attitude_in_degrees(make_vehicle_sequence())))
    codes = [item.code for item in warn_of_inconsistency(found)]
    assert "attitude-inconsistent" in codes


def test_wrong_ranges_are_named_with_their_size() -> None:
    found = measure(solve_vehicle(tracks=with_range_error(observe_floor(), 1.2)))
    message = {item.code: item.message for item in warn_of_inconsistency(found)}["calibration-inconsistent"]
    assert "ranges are stated too long by" in message
    assert not withdraw_well_constrained(make_landmarks(5, 2), found).well_constrained.any()


def test_the_sonar_alone_has_no_scores() -> None:
    solution = solve_vehicle(navigation=False)
    sensors = replace(solution.problem.sensors, measured=False)
    found = measure(replace(solution, problem=replace(solution.problem, sensors=sensors)))
    assert found.calibration == () and {item.sensor for item in found.residuals} == {"sonar range", "sonar bearing"}


@pytest.mark.parametrize(
    ("sensor", "code"),
    [
        ("odometry rotation", "odometry-inconsistent"),
        ("odometry translation", "odometry-inconsistent"),
        ("depth", "depth-inconsistent"),
        ("attitude", "attitude-inconsistent"),
        ("sonar range", "images-inconsistent"),
        ("sonar bearing", "images-inconsistent"),
    ],
)
def test_each_sensor_has_its_code_with_numbers_and_frames(sensor: str, code: str) -> None:
    others = tuple(statistics(name, False) for name in ("odometry rotation", "depth", "attitude"))
    (warning,) = warn_of_inconsistency(Consistency((*others, statistics(sensor, True))))
    assert warning.code == code and warning.frames == ((3, 14),)
    assert f"{sensor} differs by 3.0 times its stated noise in frames 3-12" in warning.message


def test_rival_explanations_are_named_best_first_and_ordinary_ones_are_not() -> None:
    scores = (
        CalibrationScore("lever_x", 0.5, 0.1, True),
        CalibrationScore("range_scale", -0.12, 0.01, True),
        CalibrationScore("odometry_scale", 0.15, 0.015, True),
        CalibrationScore("mounting_yaw", 0.0, 0.1),
    )
    (warning,) = warn_of_inconsistency(Consistency((), scores))
    assert warning.message.endswith(
        "ranges are stated too short by 12 +- 1 %, or odometry's steps are too long by 15 +- 2 %"
    )


def test_images_of_which_little_agrees_contradict_the_result() -> None:
    solution = solve_vehicle()
    few = solution.observed & (np.arange(len(solution.observed)) % 5 == 0)
    assert measure_used_share(solution, 40) == 1.0
    share = measure_used_share(replace(solution, observed=few), 1000)
    assert share == pytest.approx(0.2, abs=0.01)
    assert measure_used_share(replace(solution, observed=few), 4) > share, "long tracks are not used whole"
    (warning,) = warn_of_inconsistency(Consistency((), (), share))
    assert warning.code == "images-inconsistent" and "only 20 %" in warning.message


@pytest.mark.parametrize(
    "consistency",
    [
        Consistency((), (), 0.2),
        Consistency((statistics("depth", True),)),
        Consistency((), (CalibrationScore("lever_x", 0.5, 0.1, True),)),
    ],
)
def test_contradicted_poses_have_no_well_constrained_landmarks(consistency: Consistency) -> None:
    landmarks = withdraw_well_constrained(make_landmarks(5, 2), consistency)
    assert not landmarks.well_constrained.any() and len(landmarks) == 5
