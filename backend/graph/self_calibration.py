"""What few numbers the tracks tell of the mounting and of the water: the lever arm's rotation, a constant range bias.

The bundle is asked for its cost around the present values; a parabola through the costs is the profile likelihood of
the few parameters, all poses and points adjusted to each. Its bottom is the estimate, its curvature the covariance.
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
PRIOR = np.array([0.17, 0.17, 0.17, 0.2])
"""How far the given values may be wrong, one sigma: a rotation about each axis in rad, the bias in m."""
PROBE = np.array([0.03, 0.03, 0.03, 0.03])
"""How far from the present values the cost is asked for."""
FARTHEST = 3.0
"""Longest step, in probes."""
ITERATIONS = 2
SETTLED = 1e-5


@dataclass(frozen=True)
class Calibration:
    """What was estimated, relative to what was given."""

    rotation_rad: FloatArray
    """(3,) rotation vector by which the sonar is turned on its mounting, about its own axes."""
    range_bias_m: float
    """What every measured range is too long."""
    sigma: FloatArray
    """(4,) standard deviations: three of the rotation in rad, one of the bias in m; 0 where not estimated."""

    def correct_mounting(self, vehicle_from_sonar: FloatArray) -> FloatArray:
        """Turn a (4, 4) lever arm as estimated."""
        turn = make_pose(np.zeros(3), Rotation.from_rotvec(self.rotation_rad))
        return np.asarray(vehicle_from_sonar @ turn)

    def diagnose(self) -> tuple[Diagnostic, ...]:
        """Report what was estimated."""
        found = []
        if self.sigma[:3].any():
            turned, sigma = np.rad2deg(self.rotation_rad), np.rad2deg(self.sigma[:3])
            axes = ", ".join(f"{turned[i]:+.2f} +- {sigma[i]:.2f} deg about {'xyz'[i]}" for i in range(3))
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
    """Estimate what the configuration asks for, by Newton's method on the profile cost.

    Args:
        problem: a bundle with the given lever arm and the measured ranges.
        world_from_vehicle: (N, 4, 4) its poses at the optimum.
        xyz_m: (T, 3) its points.
    """
    asked = np.array([config.estimate_lever_rotation] * 3 + [config.estimate_range_bias])
    chosen = np.flatnonzero(asked)
    values, covariance = np.zeros(4), np.zeros((len(chosen), len(chosen)))

    def cost(offset: FloatArray) -> float:
        at = values.copy()
        at[chosen] += offset
        bundle = adjust_bundle(_apply(problem, at), world_from_vehicle, xyz_m, settled=SETTLED)
        return float(bundle.graph.error(bundle.values)) + 0.5 * float(np.sum((at[chosen] / PRIOR[chosen]) ** 2))

    for _ in range(ITERATIONS if len(chosen) else 0):
        here, gradient, hessian = _fit_parabola(cost, PROBE[chosen])
        eigenvalues, axes = np.linalg.eigh(hessian)
        covariance = axes / np.maximum(eigenvalues, np.min(PRIOR[chosen] ** -2.0)) @ axes.T
        step = -covariance @ gradient
        step *= min(1.0, FARTHEST / max(float(np.max(np.abs(step / PROBE[chosen]))), 1e-12))
        if cost(step) >= here:
            break
        values[chosen] += step
        if np.all(np.abs(step) < 0.1 * np.sqrt(np.diag(covariance))):
            break
    sigma = np.zeros(4)
    sigma[chosen] = np.sqrt(np.diag(covariance))
    return Calibration(values[:3], float(values[3]), sigma)


def _apply(problem: BundleProblem, values: FloatArray) -> BundleProblem:
    calibration = Calibration(values[:3], float(values[3]), np.zeros(4))
    range_m = np.maximum(problem.tracks.range_m - calibration.range_bias_m, 1e-3)
    return replace(
        problem,
        tracks=replace(problem.tracks, range_m=range_m),
        vehicle_from_sonar=calibration.correct_mounting(problem.vehicle_from_sonar),
    )


def _fit_parabola(cost: Cost, probe: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Give value, gradient (P,) and Hessian (P, P) at zero of the parabola through the costs around it."""
    count = len(probe)
    unit = np.diag(probe)
    here = cost(np.zeros(count))
    ahead, behind = (np.array([cost(sign * row) for row in unit]) for sign in (1.0, -1.0))
    hessian = np.diag((ahead + behind - 2 * here) / probe**2)
    for i in range(count):
        for j in range(i):
            mixed = cost(unit[i] + unit[j]) - ahead[i] - ahead[j] + here
            hessian[i, j] = hessian[j, i] = mixed / (probe[i] * probe[j])
    return here, (ahead - behind) / (2 * probe), hessian
