"""Odometry before the court: what the images say of it, and whom they believe where navigation contradicts it."""

from collections.abc import Sequence as Rows
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.config import Config
from asfm.diagnostics import Diagnostic
from asfm.geometry.feature_noise import feature_sigma
from asfm.geometry.poses import depth_roll_pitch, heading, invert, make_pose, steps_between
from asfm.navigation.depth_attitude import DepthAttitude
from asfm.navigation.odometry_hypotheses import (
    GIVEN,
    PointPairs,
    expected_arc_distance_m,
    median_arc_distance_m,
    odometry_hypotheses,
)
from asfm.navigation.outlier_filter import MAD_TO_SIGMA
from asfm.navigation.sensor_consistency import compare_odometry_attitude, describe_conflicts
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.sequence import Sequence
from asfm.types import FloatArray, SensorNoise

FEWEST_PAIRS = 8
"""Pairs of frames below which the images are no witness."""
CONTRADICTED = 1.5
"""Odometry is contradicted when points lie this many times the expected distance from where it puts them; right
odometry makes about half of it."""
DOUBTFUL = 0.75
"""From this many times on it is, too, where it is worse than no motion at all, or a usual fault explains it."""
BETTER = 0.6
"""Another explanation counts when it leaves at most this share of the distance."""
EQUAL = 1.15
"""Explanations whose distances differ by less are equal."""
WORSE = 1.25
"""Odometry is worse than no motion at all when it leaves this many times its distance."""
AS_GOOD = 0.9
"""The images side with navigation when its height and tilt take the distance below this share."""
STILL = "without any motion"
SHOWN = "by the motion that the images show"


@dataclass(frozen=True)
class OdometryTest:
    """How far points lie from where each explanation puts them, in the median over pairs of frames."""

    pairs: int
    distance_m: dict[str, float]
    over_expected: float
    """Odometry's own distance over what noise makes of it."""

    @property
    def likely(self) -> str | None:
        """The fault without which odometry fits the images best, if it fits them well; of equals the commonest."""
        faults = {name: miss_m for name, miss_m in self.distance_m.items() if name not in (GIVEN, STILL, SHOWN)}
        least_m = min(faults.values())
        best = next(name for name, miss_m in faults.items() if miss_m <= EQUAL * least_m)
        return best if least_m < BETTER * self.distance_m[GIVEN] else None

    @property
    def contradicted(self) -> bool:
        """Whether the images contradict the odometry clearly."""
        given_m = self.distance_m[GIVEN]
        if self.distance_m[SHOWN] > BETTER * given_m:
            return False
        doubtful = self.likely is not None or given_m > WORSE * self.distance_m[STILL]
        return self.over_expected > (DOUBTFUL if doubtful else CONTRADICTED)


def compare_odometry_hypotheses(
    world_from_vehicle: FloatArray,
    sensors: SensorConstraints,
    point_pairs: Rows[PointPairs],
    sequence: Sequence,
    config: Config,
) -> OdometryTest | None:
    """Hold odometry, (N, 4, 4), and what it may be in truth against the images; None where these show too little."""
    if len(point_pairs) < FEWEST_PAIRS:
        return None
    lever = sequence.vehicle_from_sonar
    distance_m = {
        name: float(np.median([median_arc_distance_m(seen, poses @ lever, sequence.sonar) for seen in point_pairs]))
        for name, poses in odometry_hypotheses(world_from_vehicle, lever).items()
    }
    still = np.broadcast_to(np.eye(4), world_from_vehicle.shape)
    distance_m[STILL] = float(np.median([median_arc_distance_m(seen, still, sequence.sonar) for seen in point_pairs]))
    distance_m[SHOWN] = float(np.median([_own_miss(seen, sequence) for seen in point_pairs]))
    sigma = feature_sigma(sequence.sonar, config.noise)
    over = [
        median_arc_distance_m(seen, world_from_vehicle @ lever, sequence.sonar)
        / expected_arc_distance_m(seen, sigma, sensors.step_sigma)
        for seen in point_pairs
    ]
    return OdometryTest(len(point_pairs), distance_m, float(np.median(over)))


def _own_miss(pair: PointPairs, sequence: Sequence) -> float:
    poses = np.stack([np.eye(4), pair.a_from_b])
    return median_arc_distance_m(replace(pair, frame_a=0, frame_b=1), poses, sequence.sonar)


def diagnose_odometry(test: OdometryTest, sigma: FloatArray) -> Diagnostic:
    """Report that the images contradict the odometry, and the (2,) sigmas in rad and m that its steps get."""
    given_m, shown_m = test.distance_m[GIVEN], test.distance_m[SHOWN]
    likely = test.likely
    seems = f", or {test.distance_m[likely]:.2g} m {likely}: it is corrected so" if likely else ""
    message = (
        f"odometry contradicts the images: over {test.pairs} frame pairs points lie {given_m:.2g} m from where "
        f"its steps put them, {test.over_expected:.1f} times the expected noise, and {shown_m:.2g} m {SHOWN}{seems}; "
        f"its steps get sigmas of {np.rad2deg(sigma[0]):.2g} deg and {sigma[1]:.2g} m"
    )
    return Diagnostic("odometry-image-conflict", message)


def diagnose_time_offset(shift_s: float, sigma: FloatArray) -> Diagnostic:
    """Report that odometry and navigation agree but for their stamps, and the (2,) sigmas that the steps get."""
    message = (
        "odometry and navigation contradict each other in roll and pitch, and agree with odometry about "
        f"{abs(shift_s):.2g} s {'earlier' if shift_s > 0 else 'later'}: its stamps seem wrong; "
        f"its steps get sigmas of {np.rad2deg(sigma[0]):.2g} deg and {sigma[1]:.2g} m"
    )
    return Diagnostic("time-offset", message)


def measure_disagreement(
    world_from_vehicle: FloatArray, point_pairs: Rows[PointPairs], vehicle_from_sonar: FloatArray
) -> FloatArray:
    """Give sigmas (2,) of one step, rotation in rad and translation in m, that cover how odometry and images differ."""
    world_from_sonar = world_from_vehicle @ vehicle_from_sonar
    differs = []
    for seen in point_pairs:
        between = invert(world_from_sonar[seen.frame_a]) @ world_from_sonar[seen.frame_b]
        turn_rad = np.linalg.norm(Rotation.from_matrix(between[:3, :3].T @ seen.a_from_b[:3, :3]).as_rotvec())
        shift_m = np.linalg.norm(between[:2, 3] - seen.a_from_b[:2, 3])
        differs.append(np.array([turn_rad, shift_m]) / abs(seen.frame_b - seen.frame_a))
    return np.asarray(MAD_TO_SIGMA * np.median(differs, axis=0))


def resolve_attitude_conflict(
    world_from_vehicle: FloatArray,
    sensors: SensorConstraints,
    point_pairs: Rows[PointPairs],
    sequence: Sequence,
) -> tuple[FloatArray, SensorConstraints]:
    """Where odometry and navigation contradict each other, take the one that the images believe.

    Without a clear answer of the images it is navigation that is left out: what is left is consistent in itself.

    Returns:
        (N, 4, 4) poses to start from, and what holds them.
    """
    depth_attitude = DepthAttitude(sensors.z_roll_pitch, sensors.z_roll_pitch_sigma)
    consistency = compare_odometry_attitude(world_from_vehicle, depth_attitude, sequence.noise)
    wrong = consistency.contradicts
    if not wrong.any():
        return world_from_vehicle, sensors
    sentences = describe_conflicts(consistency)
    lever = sequence.vehicle_from_sonar
    if len(point_pairs) >= FEWEST_PAIRS:
        readings = np.where(wrong, sensors.z_roll_pitch, depth_roll_pitch(world_from_vehicle))
        corrected = _with_depth_attitude(world_from_vehicle, readings)
        given, other = (
            float(np.mean([median_arc_distance_m(seen, poses @ lever, sequence.sonar) for seen in point_pairs]))
            for poses in (world_from_vehicle, corrected)
        )
        if other < AS_GOOD * given:
            told = (
                f"the images agree with navigation ({other:.2g} m instead of {given:.2g} m): odometry takes its values"
            )
            found = tuple(Diagnostic("sensor-conflict", f"{sentence}; {told}") for sentence in sentences)
            return corrected, recompute_steps(sensors, corrected, sequence.noise, found)
    sigma = sensors.z_roll_pitch_sigma.copy()
    sigma[:, wrong] = np.inf
    found = tuple(Diagnostic("sensor-conflict", f"{sentence}; navigation's is left out") for sentence in sentences)
    return world_from_vehicle, replace(sensors, z_roll_pitch_sigma=sigma, diagnostics=(*sensors.diagnostics, *found))


def recompute_steps(
    sensors: SensorConstraints,
    world_from_vehicle: FloatArray,
    noise: SensorNoise,
    diagnostics: tuple[Diagnostic, ...],
) -> SensorConstraints:
    """Measure the steps between corrected poses, (N, 4, 4), with the noise that the readings added to them."""
    angle_rad = max(noise.navigation_roll_rad, noise.navigation_pitch_rad)
    added = np.sqrt(2.0) * np.array([angle_rad, noise.navigation_z_m])
    return replace(
        sensors,
        first_pose=world_from_vehicle[0],
        steps=steps_between(world_from_vehicle),
        step_sigma=np.hypot(sensors.step_sigma, added),
        diagnostics=(*sensors.diagnostics, *diagnostics),
    )


def _with_depth_attitude(world_from_vehicle: FloatArray, z_roll_pitch: FloatArray) -> FloatArray:
    """Give poses the (N, 3) height, roll and pitch of readings, and leave heading and place."""
    angles = np.stack([heading(world_from_vehicle), z_roll_pitch[:, 2], z_roll_pitch[:, 1]], axis=1)
    place = np.concatenate([world_from_vehicle[:, :2, 3], z_roll_pitch[:, :1]], axis=1)
    return make_pose(place, Rotation.from_euler("ZYX", angles))
