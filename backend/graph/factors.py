"""GTSAM factors: sonar range, bearing and elevation, odometry steps, depth and attitude.

All are native: a CustomFactor in Python is tens of times slower. GTSAM's BearingRangeFactor3D is not used because with
anisotropic noise its tangent basis swaps azimuth and elevation where the azimuth is the smaller. Bearing and elevation
are measured by a unit pinhole camera that looks along the beam: the horizontal image coordinate of a point is the
tangent of its bearing error, the vertical one is tan(elevation) / cos(bearing error).
"""

import gtsam
import numpy as np

from asfm.types import FloatArray

UNKNOWN_ELEVATION_SIGMA = 1e2
"""Standard deviation of a tangent that is not measured, such as tan(elevation) in a bearing factor."""
UNMEASURED_SIGMA_RAD = 1e2
"""Standard deviation of an angle that is not measured."""
MIN_COS_PITCH = 1e-2
"""Lower bound of cos(pitch) in attitude factors: roll is unobservable at a pitch of 90 degrees, and the noise model
must stay invertible."""
CAUCHY_SIGMAS, HUBER_SIGMAS = 2.0, 3.0
"""Scales of the robust kernels: of the sonar's factors, and of depth and attitude."""
UNIT_CAMERA = gtsam.Cal3_S2(1.0, 1.0, 0.0, 0.0, 0.0)


def sonar_from_beam(bearing_rad: float) -> gtsam.Rot3:
    """Return the rotation from a beam camera (x lateral, y vertical, z along the beam) to the sonar frame."""
    sine, cosine = np.sin(bearing_rad), np.cos(bearing_rad)
    return gtsam.Rot3(np.array([[-sine, 0.0, cosine], [cosine, 0.0, sine], [0.0, 1.0, 0.0]]))


def cauchy(sigmas: FloatArray, scale: float = CAUCHY_SIGMAS) -> gtsam.noiseModel.Base:
    """Return a diagonal noise model with a Cauchy kernel.

    Args:
        sigmas: (D,) standard deviations of the residual.
        scale: residual in sigmas at which the kernel halves the weight.
    """
    kernel = gtsam.noiseModel.mEstimator.Cauchy.Create(scale)
    return gtsam.noiseModel.Robust.Create(kernel, gtsam.noiseModel.Diagonal.Sigmas(sigmas))


def bearing_factor(
    pose_key: int, point_key: int, bearing_rad: float, sigma_rad: float, vehicle_from_sonar: gtsam.Pose3
) -> gtsam.NonlinearFactor:
    """Constrain a point to the vertical plane of a beam; its elevation stays free."""
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
    """Constrain the elevation of a point in a beam; its bearing stays free."""
    vehicle_from_beam = vehicle_from_sonar.compose(gtsam.Pose3(sonar_from_beam(bearing_rad), np.zeros(3)))
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([UNKNOWN_ELEVATION_SIGMA, sigma_rad]))
    measured = np.array([0.0, np.tan(elevation_rad)])
    return gtsam.GenericProjectionFactorCal3_S2(measured, noise, pose_key, point_key, UNIT_CAMERA, vehicle_from_beam)


def range_factor(
    pose_key: int, point_key: int, range_m: float, sigma_m: float, vehicle_from_sonar: gtsam.Pose3
) -> gtsam.NonlinearFactor:
    """Constrain the distance of a point from the sonar."""
    return gtsam.RangeFactorWithTransform3D(
        pose_key, point_key, range_m, cauchy(np.array([sigma_m])), vehicle_from_sonar
    )


def huber(noise: gtsam.noiseModel.Base, sigmas: float = HUBER_SIGMAS) -> gtsam.noiseModel.Base:
    """Add a Huber kernel to a noise model: linear cost beyond this many sigmas."""
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(sigmas), noise)


def first_pose_factor(pose_key: int, world_from_vehicle: FloatArray, sigma: FloatArray) -> gtsam.NonlinearFactor:
    """Constrain a pose with standard deviations about and along the axes of the world.

    GTSAM's residual is in the axes of the measured pose: the square root of the information matrix turns it into those
    of the world and divides by the sigmas, so that no covariance is inverted and a yaw of the world changes nothing.

    Args:
        pose_key: key of the pose.
        world_from_vehicle: (4, 4) measured pose.
        sigma: (6,) rotation in rad, then translation in m, about and along the world's x, y and z.
    """
    rotation = np.kron(np.eye(2), world_from_vehicle[:3, :3])
    noise = gtsam.noiseModel.Gaussian.SqrtInformation(rotation / sigma[:, None], False)
    return gtsam.PriorFactorPose3(pose_key, gtsam.Pose3(world_from_vehicle), noise)


def depth_factor(pose_key: int, z_m: float, sigma_m: float) -> gtsam.NonlinearFactor:
    """Constrain the z of the vehicle in the world; its horizontal position stays free.

    The precisions of x and y are zero, so that the residual the Huber kernel weighs is that of z, wherever the origin.
    """
    noise = gtsam.noiseModel.Diagonal.Precisions(np.array([0.0, 0.0, sigma_m**-2]))
    return gtsam.PoseTranslationPrior3D(pose_key, np.array([0.0, 0.0, z_m]), huber(noise))


def attitude_factor(
    pose_key: int, roll_pitch_rad: FloatArray, sigma_rad: FloatArray, yaw_rad: float
) -> gtsam.NonlinearFactor:
    """Constrain roll and pitch by the direction of the world's z axis in the vehicle frame; yaw stays free.

    GTSAM's residual is the horizontal part of the measured up direction in the world frame, as (-y, x). At heading h
    an error d of the roll changes it by cos(pitch) d along (cos h, sin h), an error d of the pitch by d along
    (-sin h, cos h): the noise model is rotated by h.

    Args:
        pose_key: key of the pose.
        roll_pitch_rad: (2,) measured angles.
        sigma_rad: (2,) standard deviations; infinite for an angle that is not measured.
        yaw_rad: approximate heading; an error of some degrees is harmless.
    """
    roll_rad, pitch_rad = roll_pitch_rad.tolist()
    up_in_vehicle = gtsam.Rot3.RzRyRx(roll_rad, pitch_rad, 0.0).unrotate(np.array([0.0, 0.0, 1.0]))
    sine, cosine = np.sin(yaw_rad), np.cos(yaw_rad)
    rotation = np.array([[cosine, -sine], [sine, cosine]])
    sigma = np.minimum(sigma_rad, UNMEASURED_SIGMA_RAD) * [max(abs(np.cos(pitch_rad)), MIN_COS_PITCH), 1.0]
    noise = gtsam.noiseModel.Gaussian.Covariance(rotation @ np.diag(sigma**2) @ rotation.T)
    up = gtsam.Unit3(np.array([0.0, 0.0, 1.0]))
    return gtsam.AttitudeFactorPose3(pose_key, up, huber(noise), gtsam.Unit3(up_in_vehicle))


def step_factor(
    first_key: int, second_key: int, first_from_second: FloatArray, rotation_rad: float, translation_m: float
) -> gtsam.NonlinearFactor:
    """Constrain the motion between two poses.

    Args:
        first_key: key of the first pose.
        second_key: key of the second pose.
        first_from_second: (4, 4) measured step.
        rotation_rad: standard deviation of the rotation about each axis.
        translation_m: standard deviation of the translation along each axis.
    """
    sigmas = np.array([rotation_rad] * 3 + [translation_m] * 3)
    return gtsam.BetweenFactorPose3(
        first_key, second_key, gtsam.Pose3(first_from_second), gtsam.noiseModel.Diagonal.Sigmas(sigmas)
    )
