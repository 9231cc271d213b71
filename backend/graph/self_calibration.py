"""Self-calibration: rotation of the lever arm and constant range bias, by profile likelihood.

The cost of the bundle adjustment, with all poses and points optimised for each value of the parameters, is minus the
logarithm of their profile likelihood. A parabola is fitted to it: its minimum is the estimate, its curvature the
inverse covariance.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.backend.graph.bundle_adjustment import adjust_bundle
from asfm.backend.graph.problem import BundleProblem
from asfm.config import BackendConfig
from asfm.diagnostics import Diagnostic
from asfm.geometry.poses import make_pose
from asfm.types import FloatArray

Cost = Callable[[FloatArray], float]
PRIOR_SIGMA = np.array([0.17, 0.17, 0.17, 0.2])
"""Prior standard deviations of the corrections: rotation about each axis in rad, range bias in m."""
PROBE_STEP = np.array([0.03, 0.03, 0.03, 0.03])
"""Differences at which the cost is evaluated for its derivatives, in rad and m."""
MAX_STEP_PROBES = 3.0
"""Longest Newton step, in probe steps."""
MAX_ITERATIONS = 2
RELATIVE_TOLERANCE = 1e-5
"""Tighter than usual: the costs of neighbouring parameter values are subtracted."""


@dataclass(frozen=True)
class Calibration:
    """Estimated corrections of the given calibration."""

    rotation_rad: FloatArray
    """(3,) rotation vector of the sonar relative to its given mounting, in the sonar frame."""
    range_bias_m: float
    """Amount by which every measured range is too long."""
    sigma: FloatArray
    """(4,) standard deviations of the rotation in rad and the range bias in m; 0 where not estimated."""

    def correct_mounting(self, vehicle_from_sonar: FloatArray) -> FloatArray:
        """Apply the estimated rotation to a (4, 4) lever arm."""
        rotation = make_pose(np.zeros(3), Rotation.from_rotvec(self.rotation_rad))
        return np.asarray(vehicle_from_sonar @ rotation)

    def diagnose(self) -> tuple[Diagnostic, ...]:
        """Report the estimated parameters."""
        found = []
        if self.sigma[:3].any():
            rotation_deg, sigma_deg = np.rad2deg(self.rotation_rad), np.rad2deg(self.sigma[:3])
            axes = ", ".join(f"{rotation_deg[i]:+.2f} +- {sigma_deg[i]:.2f} deg about {'xyz'[i]}" for i in range(3))
            message = f"the lever arm's rotation was estimated: the sonar is rotated by {axes} from what is given"
            found.append(Diagnostic("estimated-lever-rotation", message, severity="info"))
        if self.sigma[3]:
            message = (
                f"a constant range bias was estimated: ranges are {self.range_bias_m:+.3f} +- {self.sigma[3]:.3f} m "
                "too long"
            )
            found.append(Diagnostic("estimated-range-bias", message, severity="info"))
        return tuple(found)


def calibrate(
    problem: BundleProblem, world_from_vehicle: FloatArray, xyz_m: FloatArray, config: BackendConfig
) -> Calibration:
    """Estimate the parameters selected in the configuration by Newton's method on the profile likelihood.

    Args:
        problem: bundle adjustment problem with the given lever arm and the measured ranges.
        world_from_vehicle: (N, 4, 4) poses at its optimum.
        xyz_m: (T, 3) points at its optimum, world frame.
        config: ``estimate_lever_rotation`` and ``estimate_range_bias`` select the parameters.
    """
    enabled = np.array([config.estimate_lever_rotation] * 3 + [config.estimate_range_bias])
    selected = np.flatnonzero(enabled)
    values, covariance = np.zeros(4), np.zeros((len(selected), len(selected)))

    def cost(offset: FloatArray) -> float:
        shifted = values.copy()
        shifted[selected] += offset
        bundle = adjust_bundle(_apply(problem, shifted), world_from_vehicle, xyz_m, RELATIVE_TOLERANCE)
        prior = 0.5 * float(np.sum((shifted[selected] / PRIOR_SIGMA[selected]) ** 2))
        return float(bundle.graph.error(bundle.values)) + prior

    for _ in range(MAX_ITERATIONS if len(selected) else 0):
        current, gradient, hessian = _fit_parabola(cost, PROBE_STEP[selected])
        eigenvalues, axes = np.linalg.eigh(hessian)
        covariance = axes / np.maximum(eigenvalues, np.min(PRIOR_SIGMA[selected] ** -2.0)) @ axes.T
        step = -covariance @ gradient
        step *= min(1.0, MAX_STEP_PROBES / max(float(np.max(np.abs(step / PROBE_STEP[selected]))), 1e-12))
        if cost(step) >= current:
            break
        values[selected] += step
        if np.all(np.abs(step) < 0.1 * np.sqrt(np.diag(covariance))):
            break
    sigma = np.zeros(4)
    sigma[selected] = np.sqrt(np.diag(covariance))
    return Calibration(values[:3], float(values[3]), sigma)


def _apply(problem: BundleProblem, values: FloatArray) -> BundleProblem:
    """Correct the lever arm and the ranges of a problem by (4,) parameter values in rad and m."""
    calibration = Calibration(values[:3], float(values[3]), np.zeros(4))
    range_m = np.maximum(problem.tracks.range_m - calibration.range_bias_m, 1e-3)
    return replace(
        problem,
        tracks=replace(problem.tracks, range_m=range_m),
        vehicle_from_sonar=calibration.correct_mounting(problem.vehicle_from_sonar),
    )


def _fit_parabola(cost: Cost, probe: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Fit a parabola to a cost around zero.

    Args:
        cost: function of (P,) offsets.
        probe: (P,) differences at which it is evaluated.

    Returns:
        Value, (P,) gradient and (P, P) Hessian at zero.
    """
    count = len(probe)
    unit = np.diag(probe)
    centre = cost(np.zeros(count))
    forward, backward = (np.array([cost(sign * row) for row in unit]) for sign in (1.0, -1.0))
    hessian = np.diag((forward + backward - 2 * centre) / probe**2)
    for i in range(count):
        for j in range(i):
            mixed = cost(unit[i] + unit[j]) - forward[i] - forward[j] + centre
            hessian[i, j] = hessian[j, i] = mixed / (probe[i] * probe[j])
    return centre, (forward - backward) / (2 * probe), hessian
