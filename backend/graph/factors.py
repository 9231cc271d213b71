"""Native GTSAM factors for what a sonar, an odometer, a depth and an attitude sensor measure.

GTSAM's own BearingRangeFactor3D is wrong for sonar with anisotropic noise (its tangent basis swaps azimuth and
elevation), and a CustomFactor in Python is tens of times slower than a native one. A beam is therefore modelled as a
unit camera that looks along it: the horizontal image coordinate of a point is the tangent of its bearing error, the
vertical one tan(elevation) / cos(bearing error), which is left almost free because the elevation is not measured.
"""

import gtsam
import numpy as np

from asfm.types import FloatArray

UNKNOWN_ELEVATION_SIGMA = 1e2
"""Standard deviation of tan(elevation): says that the elevation is not measured."""
NOTHING_KNOWN_RAD = 1e2
"""Standard deviation of an angle that was not measured."""
UNIT_CAMERA = gtsam.Cal3_S2(1.0, 1.0, 0.0, 0.0, 0.0)


def sonar_from_beam(bearing_rad: float) -> gtsam.Rot3:
    """Turn a camera (x lateral, y vertical, z forward) so that it looks along the beam at a bearing."""
    sine, cosine = np.sin(bearing_rad), np.cos(bearing_rad)
    return gtsam.Rot3(np.array([[-sine, 0.0, cosine], [cosine, 0.0, sine], [0.0, 1.0, 0.0]]))


def cauchy(sigmas: FloatArray, scale: float = 2.0) -> gtsam.noiseModel.Base:
    """Make a diagonal noise model with a Cauchy kernel, which forgives observations beyond a few sigmas."""
    kernel = gtsam.noiseModel.mEstimator.Cauchy.Create(scale)
    return gtsam.noiseModel.Robust.Create(kernel, gtsam.noiseModel.Diagonal.Sigmas(sigmas))


def bearing_factor(
    pose_key: int, point_key: int, bearing_rad: float, sigma_rad: float, vehicle_from_sonar: gtsam.Pose3
) -> gtsam.NonlinearFactor:
    """Constrain a point to the vertical plane of a beam; the elevation stays unknown."""
    vehicle_from_beam = vehicle_from_sonar.compose(gtsam.Pose3(sonar_from_beam(bearing_rad), np.zeros(3)))
    noise = cauchy(np.array([sigma_rad, UNKNOWN_ELEVATION_SIGMA]))
    return gtsam.GenericProjectionFactorCal3_S2(np.zeros(2), noise, pose_key, point_key, UNIT_CAMERA, vehicle_from_beam)


def elevation_factor(
    pose_key: int,
    point_key: int,
    bearing_rad: float,
    elevation_rad: float,
    sigma_rad: float,
    vehicle_from_sonar: gtsam.Pose3,
) -> gtsam.NonlinearFactor:
    """Pull a point to an elevation of a beam."""
    vehicle_from_beam = vehicle_from_sonar.compose(gtsam.Pose3(sonar_from_beam(bearing_rad), np.zeros(3)))
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([UNKNOWN_ELEVATION_SIGMA, sigma_rad]))
    measured = np.array([0.0, np.tan(elevation_rad)])
    return gtsam.GenericProjectionFactorCal3_S2(measured, noise, pose_key, point_key, UNIT_CAMERA, vehicle_from_beam)


def range_factor(
    pose_key: int, point_key: int, range_m: float, sigma_m: float, vehicle_from_sonar: gtsam.Pose3
) -> gtsam.NonlinearFactor:
    """Constrain a point to the sphere of a range around the sonar."""
    return gtsam.RangeFactorWithTransform3D(
        pose_key, point_key, range_m, cauchy(np.array([sigma_m])), vehicle_from_sonar
    )


def huber(noise: gtsam.noiseModel.Base, sigmas: float = 3.0) -> gtsam.noiseModel.Base:
    """Wrap a noise model so that readings beyond a few sigmas pull no harder than those; within, it changes nothing."""
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(sigmas), noise)


def depth_factor(pose_key: int, z_m: float, sigma_m: float) -> gtsam.NonlinearFactor:
    """Constrain the vehicle's height in the world; the horizontal position stays free."""
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([1e4, 1e4, sigma_m]))
    return gtsam.PoseTranslationPrior3D(pose_key, np.array([0.0, 0.0, z_m]), huber(noise))


def attitude_factor(
    pose_key: int, roll_pitch_rad: FloatArray, sigma_rad: FloatArray, yaw_rad: float
) -> gtsam.NonlinearFactor:
    """Constrain roll and pitch: the world's up, seen from the vehicle, points where the attitude sensor says.

    GTSAM's residual is where that measured up points in the world, (-y, x) beside the zenith. With the heading h, an
    error of roll moves it by cos(pitch) times the error along (cos h, sin h), an error of pitch by its own along
    (-sin h, cos h).

    Args:
        roll_pitch_rad, sigma_rad: (2,) the reading and its standard deviations; infinite for one not measured.
        yaw_rad: heading, which tells the two apart; some degrees of error do no harm.
    """
    roll_rad, pitch_rad = roll_pitch_rad.tolist()
    up_in_vehicle = gtsam.Rot3.RzRyRx(roll_rad, pitch_rad, 0.0).unrotate(np.array([0.0, 0.0, 1.0]))
    sine, cosine = np.sin(yaw_rad), np.cos(yaw_rad)
    turn = np.array([[cosine, -sine], [sine, cosine]])
    least = 1e-2  # looking straight up or down, roll is hardly seen, but the noise model must not be singular
    sigma = np.minimum(sigma_rad, NOTHING_KNOWN_RAD) * [max(abs(np.cos(pitch_rad)), least), 1.0]
    noise = gtsam.noiseModel.Gaussian.Covariance(turn @ np.diag(sigma**2) @ turn.T)
    up = gtsam.Unit3(np.array([0.0, 0.0, 1.0]))
    return gtsam.AttitudeFactorPose3(pose_key, up, huber(noise), gtsam.Unit3(up_in_vehicle))


def step_factor(
    first_key: int, second_key: int, first_from_second: FloatArray, rotation_rad: float, translation_m: float
) -> gtsam.NonlinearFactor:
    """Constrain the motion between two poses to a measured step (4, 4)."""
    sigmas = np.array([rotation_rad] * 3 + [translation_m] * 3)
    return gtsam.BetweenFactorPose3(
        first_key, second_key, gtsam.Pose3(first_from_second), gtsam.noiseModel.Diagonal.Sigmas(sigmas)
    )
