"""Hypothesis test of odometry against image matches."""

from collections.abc import Sequence as Rows
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.config import Config
from asfm.geometry.feature_noise import feature_sigma
from asfm.geometry.poses import invert
from asfm.geometry.sonar import SonarModel
from asfm.navigation.fault_hypotheses import Hypothesis, ImageAxis, fault_hypotheses, hypothesis_distances
from asfm.navigation.hypothesis_plausibility import sort_by_plausibility
from asfm.navigation.odometry_hypotheses import (
    AS_RECORDED,
    PointPairs,
    expected_arc_distance_m,
    median_arc_distance_m,
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
PLANAR_RATIO = 2.5
"""A fault explains the images when its arc distance is at most this multiple of that of their own planar motion."""
RIVAL_RATIO = 1.3
"""Hypotheses whose arc distances differ by at most this factor are named beside each other."""
USUAL_RATIO = 0.65
"""Right odometry has an arc distance of at most about this multiple of the expected one."""
USUAL_BETTER_FIT_RATIO = 0.75
"""A fault whose correction does as well need only be this much better than a stationary sonar."""
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
    """Arc distance by hypothesis; of equal ones the first is the likeliest. Only that of the recorded odometry where
    this is within the noise."""
    stationary_m: float
    """Arc distance without any motion."""
    planar_m: float
    """Arc distance under the planar motion fitted to each frame pair."""
    over_expected: float
    """Arc distance of the odometry as recorded over that of noise alone."""
    hypotheses: dict[str, Hypothesis] = field(default_factory=dict)
    """By name."""

    @property
    def suspicious(self) -> bool:
        """Whether the odometry lies beyond the noise, so that hypotheses of faults were tested."""
        return bool(self.hypotheses)

    @property
    def image_axis(self) -> ImageAxis | None:
        """The axis of the images that is likely reversed."""
        likely = self.hypotheses.get(str(self.likely_fault)) if self.contradicted else None
        return None if likely is None else likely.images

    @property
    def mounting(self) -> FloatArray | None:
        """The (4, 4) mounting that explains the images with the odometry as recorded, if a turned one is likely."""
        likely = self.hypotheses.get(str(self.likely_fault)) if self.contradicted else None
        return None if likely is None else likely.vehicle_from_sonar

    @property
    def best_hypothesis(self) -> str | None:
        """The fault whose correction fits the images best, if it fits clearly better; the likeliest of equal ones."""
        faults = {name: distance_m for name, distance_m in self.distance_m.items() if name != AS_RECORDED}
        least_m = min(faults.values(), default=np.inf)
        best = [name for name, distance_m in faults.items() if distance_m <= TIE_RATIO * least_m]
        return best[0] if least_m < BETTER_FIT_RATIO * self.distance_m[AS_RECORDED] else None

    @property
    def likely_fault(self) -> str | None:
        """The best hypothesis, if it explains the images: nearly as well as their own motion or as noise alone does.

        It must also be clearly better than no motion at all; else it is only the least bad one.
        """
        best, noise_m = self.best_hypothesis, self.distance_m[AS_RECORDED] / max(self.over_expected, 1e-12)
        if best is None:
            return None
        explained_m = max(PLANAR_RATIO * self.planar_m, CONFLICT_RATIO_WITH_ALTERNATIVE * noise_m)
        within_noise = self.distance_m[best] < USUAL_RATIO * noise_m
        better_than_still_m = (USUAL_BETTER_FIT_RATIO if within_noise else BETTER_FIT_RATIO) * self.stationary_m
        return best if self.distance_m[best] < min(better_than_still_m, explained_m) else None

    @property
    def rivals(self) -> tuple[str, ...]:
        """Hypotheses that fit about as well as the likely fault."""
        best = self.likely_fault
        limit_m = RIVAL_RATIO * self.distance_m[best] if best else 0.0
        return tuple(name for name, distance_m in self.distance_m.items() if name != best and distance_m <= limit_m)

    @property
    def contradicted(self) -> bool:
        """Whether the images clearly contradict the odometry."""
        recorded_m = self.distance_m[AS_RECORDED]
        if self.planar_m > BETTER_FIT_RATIO * recorded_m:
            return False
        worse_than_stationary = recorded_m > WORSE_THAN_STATIONARY_RATIO * self.stationary_m
        alternative = self.best_hypothesis is not None or worse_than_stationary
        return self.over_expected > (CONFLICT_RATIO_WITH_ALTERNATIVE if alternative else CONFLICT_RATIO)


def compare_odometry_hypotheses(
    world_from_vehicle: FloatArray,
    sensors: SensorConstraints,
    point_pairs: Rows[PointPairs],
    sequence: Sequence,
    config: Config,
    candidates: Rows[PointPairs] | None = None,
) -> OdometryTest | None:
    """Compare the odometry, and where it is beyond the noise hypotheses of common faults, with the images.

    Args:
        world_from_vehicle: (N, 4, 4) odometry.
        sensors: give the sigmas of its steps, depth and attitude.
        point_pairs: planar-motion inliers of frame pairs.
        sequence: gives the sonar and its lever arm.
        config: section ``noise``, and on which side of the sonar the scene lies.
        candidates: the matched points from which the inliers were chosen, where there are more.

    Returns:
        None with fewer than :data:`MIN_FRAME_PAIRS` frame pairs.
    """
    if len(point_pairs) < MIN_FRAME_PAIRS:
        return None
    lever, sonar = sequence.vehicle_from_sonar, sequence.sonar
    stationary = np.broadcast_to(np.eye(4), world_from_vehicle.shape)
    recorded_m, stationary_m = (
        float(np.median([median_arc_distance_m(pair, poses, sonar) for pair in point_pairs]))
        for poses in (world_from_vehicle @ lever, stationary)
    )
    planar_m = float(np.median([_planar_arc_distance_m(pair, sonar) for pair in point_pairs]))
    sigma = feature_sigma(sonar, config.noise)
    ratios = [
        median_arc_distance_m(pair, world_from_vehicle @ lever, sonar)
        / expected_arc_distance_m(pair, sigma, sensors.step_sigma)
        for pair in point_pairs
    ]
    over_expected = float(np.median(ratios))
    recorded = OdometryTest(len(point_pairs), {AS_RECORDED: recorded_m}, stationary_m, planar_m, over_expected)
    if over_expected <= CONFLICT_RATIO_WITH_ALTERNATIVE or planar_m > BETTER_FIT_RATIO * recorded_m:
        return recorded
    hypotheses = fault_hypotheses(world_from_vehicle, lever, point_pairs, sequence.timestamps_s)
    hypotheses = sort_by_plausibility(hypotheses, sensors.depth_attitude, sequence, config.backend.scene)
    distance_m = hypothesis_distances(hypotheses, candidates or point_pairs, point_pairs, lever, sonar)
    return replace(recorded, distance_m=distance_m, hypotheses={item.name: item for item in hypotheses})


def _planar_arc_distance_m(pair: PointPairs, sonar: SonarModel) -> float:
    """Return the median arc distance of a pair under its own planar motion."""
    poses = np.stack([np.eye(4), pair.a_from_b])
    return median_arc_distance_m(replace(pair, frame_a=0, frame_b=1), poses, sonar)


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
