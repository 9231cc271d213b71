"""Hypothesis test of odometry against image matches."""

from collections.abc import Sequence as Rows
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.config import Config
from asfm.diagnostics import Diagnostic
from asfm.geometry.feature_noise import feature_sigma
from asfm.geometry.poses import invert
from asfm.geometry.sonar import SonarModel
from asfm.navigation.odometry_hypotheses import (
    AS_RECORDED,
    PointPairs,
    expected_arc_distance_m,
    median_arc_distance_m,
    odometry_hypotheses,
)
from asfm.navigation.outlier_filter import MAD_TO_SIGMA
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.sequence import Sequence
from asfm.types import FloatArray

MIN_FRAME_PAIRS = 8
"""With fewer frame pairs the odometry is not tested."""
CONFLICT_RATIO = 1.5
"""Odometry contradicts the images when its arc distance exceeds the expected one by this factor; the ratio of right
odometry is about 0.5."""
CONFLICT_RATIO_WITH_ALTERNATIVE = 0.75
"""The same where a common fault explains the images, or where no motion at all explains them better."""
BETTER_FIT_RATIO = 0.6
"""An alternative explains the images better when its arc distance is at most this share of the odometry's."""
TIE_RATIO = 1.15
"""Hypotheses whose arc distances differ by at most this factor are equally good."""
WORSE_THAN_STATIONARY_RATIO = 1.25
"""Odometry is worse than no motion at all when its arc distance exceeds that of a stationary sonar by this factor."""


@dataclass(frozen=True)
class OdometryTest:
    """Hypothesis test of the odometry: arc distances under each hypothesis, in the median over frame pairs."""

    pairs: int
    """Number of frame pairs."""
    distance_m: dict[str, float]
    """Arc distance by hypothesis, see :func:`odometry_hypotheses`."""
    stationary_m: float
    """Arc distance without any motion."""
    planar_m: float
    """Arc distance under the planar motion fitted to each frame pair."""
    over_expected: float
    """Arc distance of the odometry as recorded over that of noise alone."""

    @property
    def likely_fault(self) -> str | None:
        """The fault whose correction fits the images best, if it fits clearly better; the commonest of equal ones."""
        faults = {name: distance_m for name, distance_m in self.distance_m.items() if name != AS_RECORDED}
        least_m = min(faults.values())
        best = next(name for name, distance_m in faults.items() if distance_m <= TIE_RATIO * least_m)
        return best if least_m < BETTER_FIT_RATIO * self.distance_m[AS_RECORDED] else None

    @property
    def contradicted(self) -> bool:
        """Whether the images clearly contradict the odometry."""
        recorded_m = self.distance_m[AS_RECORDED]
        if self.planar_m > BETTER_FIT_RATIO * recorded_m:
            return False
        worse_than_stationary = recorded_m > WORSE_THAN_STATIONARY_RATIO * self.stationary_m
        alternative = self.likely_fault is not None or worse_than_stationary
        return self.over_expected > (CONFLICT_RATIO_WITH_ALTERNATIVE if alternative else CONFLICT_RATIO)


def compare_odometry_hypotheses(
    world_from_vehicle: FloatArray,
    sensors: SensorConstraints,
    point_pairs: Rows[PointPairs],
    sequence: Sequence,
    config: Config,
) -> OdometryTest | None:
    """Compare the odometry and hypotheses of its common faults with the images.

    Args:
        world_from_vehicle: (N, 4, 4) odometry.
        sensors: give the sigmas of its steps.
        point_pairs: planar-motion inliers of frame pairs.
        sequence: gives the sonar and its lever arm.
        config: section ``noise``.

    Returns:
        None with fewer than :data:`MIN_FRAME_PAIRS` frame pairs.
    """
    if len(point_pairs) < MIN_FRAME_PAIRS:
        return None
    lever, sonar = sequence.vehicle_from_sonar, sequence.sonar
    distance_m = {
        name: float(np.median([median_arc_distance_m(pair, poses @ lever, sonar) for pair in point_pairs]))
        for name, poses in odometry_hypotheses(world_from_vehicle, lever).items()
    }
    stationary = np.broadcast_to(np.eye(4), world_from_vehicle.shape)
    stationary_m = float(np.median([median_arc_distance_m(pair, stationary, sonar) for pair in point_pairs]))
    planar_m = float(np.median([_planar_arc_distance_m(pair, sonar) for pair in point_pairs]))
    sigma = feature_sigma(sonar, config.noise)
    ratios = [
        median_arc_distance_m(pair, world_from_vehicle @ lever, sonar)
        / expected_arc_distance_m(pair, sigma, sensors.step_sigma)
        for pair in point_pairs
    ]
    return OdometryTest(len(point_pairs), distance_m, stationary_m, planar_m, float(np.median(ratios)))


def _planar_arc_distance_m(pair: PointPairs, sonar: SonarModel) -> float:
    """Return the median arc distance of a pair under its own planar motion."""
    poses = np.stack([np.eye(4), pair.a_from_b])
    return median_arc_distance_m(replace(pair, frame_a=0, frame_b=1), poses, sonar)


def diagnose_odometry(test: OdometryTest, sigma: FloatArray) -> Diagnostic:
    """Report that the images contradict the odometry, and the (2,) sigmas in rad and m that its steps get."""
    recorded_m, fault = test.distance_m[AS_RECORDED], test.likely_fault
    seems = f", or {test.distance_m[fault]:.2g} m {fault}: it is corrected so" if fault else ""
    message = (
        f"odometry contradicts the images: over {test.pairs} frame pairs points lie {recorded_m:.2g} m from where "
        f"its steps put them, {test.over_expected:.1f} times the expected noise, and {test.planar_m:.2g} m by a planar "
        f"motion fitted to them{seems}; its steps get sigmas of {np.rad2deg(sigma[0]):.2g} deg and {sigma[1]:.2g} m"
    )
    return Diagnostic("odometry-image-conflict", message)


def diagnose_time_offset(shift_s: float, sigma: FloatArray) -> Diagnostic:
    """Report a time offset between odometry and navigation, and the (2,) sigmas in rad and m that the steps get."""
    message = (
        "odometry and navigation contradict each other in roll and pitch, and agree with odometry about "
        f"{abs(shift_s):.2g} s {'earlier' if shift_s > 0 else 'later'}: its stamps seem wrong; "
        f"its steps get sigmas of {np.rad2deg(sigma[0]):.2g} deg and {sigma[1]:.2g} m"
    )
    return Diagnostic("time-offset", message)


def measure_disagreement(
    world_from_vehicle: FloatArray, point_pairs: Rows[PointPairs], vehicle_from_sonar: FloatArray
) -> FloatArray:
    """Estimate the sigmas of a step that cover the difference between odometry and the planar motions of the images.

    Args:
        world_from_vehicle: (N, 4, 4) odometry.
        point_pairs: planar-motion inliers of frame pairs.
        vehicle_from_sonar: (4, 4) lever arm.

    Returns:
        (2,) rotation in rad and translation in m.
    """
    world_from_sonar = world_from_vehicle @ vehicle_from_sonar
    differences = []
    for pair in point_pairs:
        a_from_b = invert(world_from_sonar[pair.frame_a]) @ world_from_sonar[pair.frame_b]
        turn_rad = np.linalg.norm(Rotation.from_matrix(a_from_b[:3, :3].T @ pair.a_from_b[:3, :3]).as_rotvec())
        shift_m = np.linalg.norm(a_from_b[:2, 3] - pair.a_from_b[:2, 3])
        differences.append(np.array([turn_rad, shift_m]) / abs(pair.frame_b - pair.frame_a))
    return np.asarray(MAD_TO_SIGMA * np.median(differences, axis=0))
