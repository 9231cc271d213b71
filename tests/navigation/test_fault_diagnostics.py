"""Diagnostics of faults: the numbers of the test, the hypotheses that fit as well, what is done, and the code."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.navigation.fault_diagnostics import (
    diagnose_images,
    diagnose_mounting,
    diagnose_odometry,
    diagnose_time_offset,
)
from asfm.navigation.fault_hypotheses import IMAGES_MIRRORED, ORDER_REVERSED, RANGE_REVERSED, Hypothesis
from asfm.navigation.odometry_check import OdometryTest
from asfm.navigation.odometry_hypotheses import AS_RECORDED

SIGMA = np.array([np.deg2rad(1.5), 0.25])
NO_POSES = np.zeros((0, 4, 4))
INVERTED = Hypothesis("inverted", NO_POSES)
REVERSED = Hypothesis(ORDER_REVERSED, NO_POSES, adoptable=False, code="images-out-of-order")
FAR_FIRST = Hypothesis(RANGE_REVERSED, NO_POSES, images="range", code="range-axis-reversed")
TURNED_LEFT = Hypothesis("with its mounting turned by 90 deg", NO_POSES, code="mounting-rotated")
MIRRORED = Hypothesis(IMAGES_MIRRORED, NO_POSES, images="bearing", code="bearing-axis-reversed")


def make_test(distance_m: dict[Hypothesis, float]) -> OdometryTest:
    distances_m = {AS_RECORDED: 0.21, **{item.name: value for item, value in distance_m.items()}}
    return OdometryTest(17, distances_m, 0.14, 0.034, 1.6, {item.name: item for item in distance_m})


@pytest.mark.parametrize(
    ("likely", "remedy"), [(INVERTED, "it is corrected so"), (REVERSED, "not corrected"), (FAR_FIRST, "not corrected")]
)
def test_conflict_is_reported_with_its_numbers_and_the_remedy(likely: Hypothesis, remedy: str) -> None:
    found = diagnose_odometry(make_test({likely: 0.041}), SIGMA)
    assert found.code == likely.code and likely.name in found.message and remedy in found.message
    for number in ("17 frame pairs", "0.21 m", "1.6 times", "0.034 m", "0.14 m", "0.041 m", "1.5 deg and 0.25 m"):
        assert number in found.message


def test_a_conflict_without_an_explanation_names_none() -> None:
    found = diagnose_odometry(make_test({INVERTED: 0.12}), SIGMA)
    assert found.code == "odometry-image-conflict" and INVERTED.name not in found.message
    assert "corrected" not in found.message


def test_reversed_images_are_reported_with_what_fits_as_well() -> None:
    found = diagnose_images(make_test({MIRRORED: 0.041, INVERTED: 0.044, REVERSED: 0.2}))
    assert found.code == "bearing-axis-reversed" and "the images are turned" in found.message
    assert "(as well: inverted)" in found.message and ORDER_REVERSED not in found.message


def test_a_turned_mounting_is_reported_as_corrected() -> None:
    found = diagnose_mounting(make_test({TURNED_LEFT: 0.041}))
    assert found.code == "mounting-rotated" and TURNED_LEFT.name in found.message
    assert "vehicle_from_sonar" in found.message and "0.21 m" in found.message


def test_the_mounting_of_the_likely_fault_is_known_where_odometry_is_contradicted() -> None:
    mounting = np.diag([-1.0, -1.0, 1.0, 1.0])
    turned = replace(TURNED_LEFT, vehicle_from_sonar=mounting)
    assert make_test({turned: 0.041}).mounting is mounting and make_test({INVERTED: 0.041}).mounting is None
    assert make_test({turned: 0.2}).mounting is None


@pytest.mark.parametrize(("shift_s", "word"), [(0.4, "0.4 s earlier"), (-1.2, "1.2 s later")])
def test_time_offset_is_reported_with_its_direction(shift_s: float, word: str) -> None:
    found = diagnose_time_offset(shift_s, np.array([np.deg2rad(2.0), 0.5]))
    assert found.code == "time-offset" and word in found.message and "2 deg and 0.5 m" in found.message
