"""Score test (Lagrange multiplier test) of calibration parameters at the optimum of a bundle adjustment.

The adjustment holds the calibration at what the recording states. One Newton step of a parameter from there, with all
poses and points free, estimates its error and the standard deviation of that estimate: with g the derivative of the
cost and S the information with everything else marginalised out, the estimate is -g / S with the variance 1 / S, and
g^2 / S is the statistic of the score test (Rao 1948), chi-square with one degree of freedom.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import splu

from asfm.backend.diagnostics.calibration_parameters import PARAMETERS
from asfm.backend.diagnostics.linearised_residuals import ResidualBlock
from asfm.backend.graph.schur_complement import PoseInformation
from asfm.types import FloatArray, IntArray

MIN_RELATIVE_INFORMATION = 1e-6
"""A parameter that is so dependent on poses and points, relative to its own information, is not observed."""


@dataclass(frozen=True)
class CalibrationScores:
    """Derivatives of the cost by K calibration parameters, at the optimum of all else."""

    gradient: FloatArray
    """(K,) first derivatives."""
    information: FloatArray
    """(K, K) second derivatives, with poses and points marginalised out and the priors of the parameters added."""
    observed: IntArray
    """Indices of the parameters that the measurements constrain."""

    def estimate(self, chosen: list[int]) -> tuple[FloatArray, FloatArray]:
        """Estimate the chosen parameters together: their (C,) values and standard deviations."""
        covariance = np.linalg.pinv(self.information[np.ix_(chosen, chosen)], hermitian=True)
        return -covariance @ self.gradient[chosen], np.sqrt(np.maximum(np.diag(covariance), 0))


def score_calibration(blocks: tuple[ResidualBlock, ...], information: PoseInformation) -> CalibrationScores:
    """Differentiate the cost by the calibration parameters.

    Args:
        blocks: linearised residuals of all sensors.
        information: that of the poses and points, at the same optimum.
    """
    count = len(PARAMETERS)
    gradient, own = np.zeros(count), np.zeros((count, count))
    with_poses = np.zeros((information.poses.shape[0], count))
    with_points = np.zeros((len(information.track), 3, count))
    column = information.first_column[:, None] + np.arange(6)
    for block in blocks:
        weighted = block.weight[:, :, None] * block.by_parameter
        gradient += np.einsum("mdk,md->k", weighted, block.residual)
        own += np.einsum("mdk,mdl->kl", weighted, block.by_parameter)
        for frame, by_pose in block.by_pose:
            np.add.at(with_poses, column[frame], np.einsum("mdi,mdk->mik", by_pose, weighted))
        if block.track is not None and block.by_point is not None:
            point = np.searchsorted(information.track, block.track)
            np.add.at(with_points, point, np.einsum("mdi,mdk->mik", block.by_point, weighted))
    with_poses += information.point_pose_gain.T @ with_points.reshape(-1, count)
    explained = np.einsum("pik,pij,pjl->kl", with_points, np.linalg.inv(information.points), with_points)
    explained += with_poses.T @ splu(information.poses).solve(with_poses)
    remaining = own - explained
    observed = np.flatnonzero(np.diag(remaining) > MIN_RELATIVE_INFORMATION * np.maximum(np.diag(own), 1e-300))
    prior = np.diag([parameter.prior_sigma**-2.0 for parameter in PARAMETERS])
    return CalibrationScores(gradient, (remaining + remaining.T) / 2 + prior, observed)
