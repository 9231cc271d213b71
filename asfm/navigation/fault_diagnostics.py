"""Diagnostics of faults of odometry and images that their hypothesis test finds."""

from dataclasses import replace

import numpy as np

from asfm.diagnostics import Diagnostic
from asfm.navigation.odometry_check import OdometryTest
from asfm.navigation.odometry_hypotheses import AS_RECORDED
from asfm.types import FloatArray

MAX_RIVALS = 3
"""Messages name at most this many hypotheses that fit as well."""
_WITHOUT_MESSAGE = (
    Diagnostic("odometry-image-conflict", ""),
    Diagnostic("marine-axes", ""),
    Diagnostic("odometry-scale", ""),
    Diagnostic("mounting-rotated", ""),
    Diagnostic("range-axis-reversed", ""),
    Diagnostic("bearing-axis-reversed", ""),
    Diagnostic("images-out-of-order", ""),
    Diagnostic("time-offset", ""),
)
_BY_CODE = {found.code: found for found in _WITHOUT_MESSAGE}


def diagnose_odometry(test: OdometryTest, sigma: FloatArray) -> Diagnostic:
    """Report that images and odometry contradict each other, and the (2,) sigmas in rad and m that its steps get."""
    recorded_m, fault = test.distance_m[AS_RECORDED], test.likely_fault
    hypothesis = test.hypotheses.get(str(fault))
    seems = ""
    if fault:
        corrected = hypothesis is None or hypothesis.correctable
        remedy = "it is corrected so; check the recording" if corrected else "not corrected; correct the recording"
        seems = f", or {test.distance_m[fault]:.2g} m {fault}{_describe_rivals(test)}: {remedy}"
    message = (
        f"images and odometry contradict each other: over {test.pairs} frame pairs points lie {recorded_m:.2g} m from "
        f"where its steps put them, {test.over_expected:.1f} times the expected noise, {test.planar_m:.2g} m "
        f"by a planar motion fitted to them, and {test.stationary_m:.2g} m without any motion{seems}; its steps get "
        f"sigmas of {np.rad2deg(sigma[0]):.2g} deg and {sigma[1]:.2g} m"
    )
    return replace(_BY_CODE["odometry-image-conflict" if hypothesis is None else hypothesis.code], message=message)


def diagnose_images(test: OdometryTest) -> Diagnostic:
    """Report that an axis of the images is reversed, which a test found the likely fault, and that it is turned."""
    return _diagnose_likely(test, "the images are turned; check the recording")


def diagnose_mounting(test: OdometryTest) -> Diagnostic:
    """Report that the mounting is turned, which a test found the likely fault, and that it is corrected."""
    return _diagnose_likely(test, "the mounting (vehicle_from_sonar) is turned so; correct it in the recording")


def _diagnose_likely(test: OdometryTest, remedy: str) -> Diagnostic:
    fault = str(test.likely_fault)
    message = (
        f"images and odometry contradict each other: over {test.pairs} frame pairs points lie "
        f"{test.distance_m[AS_RECORDED]:.2g} m from where its steps put them, and {test.distance_m[fault]:.2g} m "
        f"{fault}{_describe_rivals(test)}: {remedy}"
    )
    return replace(_BY_CODE[test.hypotheses[fault].code], message=message)


def diagnose_time_offset(shift_s: float, sigma: FloatArray) -> Diagnostic:
    """Report a time offset between odometry and navigation, and the (2,) sigmas in rad and m that the steps get."""
    message = (
        "odometry and navigation contradict each other in roll and pitch, and agree with odometry about "
        f"{abs(shift_s):.2g} s {'earlier' if shift_s > 0 else 'later'}: its stamps seem wrong; "
        f"its steps get sigmas of {np.rad2deg(sigma[0]):.2g} deg and {sigma[1]:.2g} m"
    )
    return Diagnostic("time-offset", message)


def _describe_rivals(test: OdometryTest) -> str:
    rivals = [name for name in test.rivals if name != AS_RECORDED][:MAX_RIVALS]
    return f" (as well: {'; '.join(rivals)})" if rivals else ""
