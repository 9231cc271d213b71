"""Mirror (Necker) ambiguity: a scene and its reflection at the sonar's plane give the same measurements.

Range and bearing do not change when the scene and all poses are reflected at the horizontal plane of the first sonar
frame; height, roll, pitch and elevation change their sign. Only other sensors (odometry, depth, attitude) can exclude
one of the two images. For the affine camera the same ambiguity is known as Necker reversal.
"""

from dataclasses import dataclass, replace

import gtsam
import numpy as np

from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.aperture_bounds import add_aperture_priors, observed_elevations
from asfm.backend.graph.bundle_adjustment import Bundle, make_values
from asfm.backend.graph.marginal_covariance import Uncertainty
from asfm.config import Scene
from asfm.diagnostics import Diagnostic
from asfm.geometry.poses import invert
from asfm.geometry.reflection import reflect, reflected_motion_jacobian, reflection_at
from asfm.types import FloatArray

MIN_PROBABILITY = 1e-6
"""An image less probable than this is excluded."""
MIN_UNDECIDED_PROBABILITY = 0.05
"""The measurements do not decide where both images are at least this probable."""
MIN_DISTANCE_SIGMAS = 3.0
"""Distance between the two images of a pose, in sigmas, from which on the ambiguity is reported."""


@dataclass(frozen=True)
class Mirror:
    """The mirror image of a solution."""

    probability: float
    """Probability, given the measurements, that the mirror image is the true one; 0.5 where they do not decide."""
    world_from_vehicle: FloatArray
    """(N, 4, 4) poses, the first one as in the solution."""
    xyz_m: FloatArray
    """(T, 3) points in the world frame."""


def find_mirror(solution: Solution, scene: Scene = "unknown") -> Mirror:
    """Reflect a solution and compute the probability of the mirror image from the costs of both.

    Args:
        solution: the image chosen by :func:`choose_mirror`.
        scene: known side of the sonar on which the scene lies; excludes the mirror image where measurements do not
            decide.
    """
    bundle = solution.bundle
    poses, points = reflect(bundle.world_from_vehicle, bundle.xyz_m, solution.problem.vehicle_from_sonar)
    mirror_cost = bundle.measured.error(make_values(poses, points, bundle.in_graph))
    cost_increase = mirror_cost - bundle.measured.error(bundle.values)
    probability = float(1 / (1 + np.exp(np.clip(cost_increase, -500.0, 500.0))))
    if probability < MIN_PROBABILITY or (scene != "unknown" and _is_undecided(probability)):
        probability = 0.0
    return Mirror(probability, poses, points)


def choose_mirror(solution: Solution, scene: Scene = "unknown") -> Solution:
    """Choose between a solution and its mirror image.

    The more probable one is chosen. Where measurements do not decide, it is the one in which far points lie higher
    than near ones, as on a bottom below the sonar, or lower for a scene above it, such as a hull. Bottoms are the
    usual case. This choice does not change the stated probability unless the scene's side is known.

    Args:
        solution: either image.
        scene: side of the sonar on which the scene lies.
    """
    other = find_mirror(solution)
    slope = _range_elevation_covariance(solution) * (-1 if scene == "above" else 1)
    mirror_is_better = slope < 0 if _is_undecided(other.probability) else other.probability > 0.5
    return replace(solution, bundle=_mirrored_bundle(solution, other)) if mirror_is_better else solution


def inflate_for_mirror(uncertainty: Uncertainty, solution: Solution, mirror: Mirror) -> Uncertainty:
    """Inflate the covariances of poses and points to their second moments over both images.

    With the distance d from an estimate to its mirror image, of probability p and covariance C', the expected squared
    error of the estimate is (1 - p) C + p (C' + d d'). Covariances of spans are kept: they describe one image.

    Args:
        uncertainty: within one image.
        solution: the image that is shown.
        mirror: the other one.
    """
    probability = mirror.probability
    if not probability:
        return uncertainty
    bundle, lever = solution.bundle, solution.problem.vehicle_from_sonar
    distance, jacobian = compare_poses(bundle.world_from_vehicle, mirror.world_from_vehicle)
    to_mirror = jacobian @ reflected_motion_jacobian(lever)
    pose = to_mirror @ uncertainty.pose @ np.swapaxes(to_mirror, 1, 2) + _outer(distance)
    reflection = reflection_at(bundle.world_from_vehicle[0] @ lever)[:3, :3]
    finite = np.isfinite(uncertainty.point_m2).all(axis=(1, 2))
    point_m2 = uncertainty.point_m2.copy()
    shift_m = mirror.xyz_m[finite] - bundle.xyz_m[finite]
    image_m2 = reflection @ point_m2[finite] @ reflection + _outer(shift_m)
    point_m2[finite] = (1 - probability) * point_m2[finite] + probability * image_m2
    pose = (1 - probability) * uncertainty.pose + probability * pose
    return replace(uncertainty, pose=(pose + np.swapaxes(pose, 1, 2)) / 2, point_m2=point_m2)


def warn_of_mirror(uncertainty: Uncertainty, bundle: Bundle, mirror: Mirror) -> tuple[Diagnostic, ...]:
    """Report the mirror ambiguity where the two images are significantly different.

    Args:
        uncertainty: within one image, not inflated.
        bundle: the image that is shown.
        mirror: the other one.
    """
    if not mirror.probability:
        return ()
    distance, _ = compare_poses(bundle.world_from_vehicle, mirror.world_from_vehicle)
    inverse = np.linalg.pinv(uncertainty.pose, hermitian=True)
    far = np.einsum("ni,nij,nj->n", distance, inverse, distance) > MIN_DISTANCE_SIGMAS**2
    if not far[1:].any():
        return ()
    turn_deg = float(np.rad2deg(np.abs(distance[:, :3]).max()))
    shift_m = float(np.linalg.norm(distance[:, 3:], axis=1).max())
    message = (
        "the scene and its mirror image at the first sonar frame's plane explain the measurements equally well "
        f"(probability of the image not shown: {mirror.probability:.2g}): heights, roll and pitch may have the other "
        f"sign; the two differ by up to {turn_deg:.2g} deg and {shift_m:.2g} m, and the sigmas include that; depth, "
        "attitude, odometry or backend.scene (below or above the sonar) would decide"
    )
    return (Diagnostic("mirror-ambiguity", message),)


def compare_poses(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute the motions from some poses to others, in the tangent space of the first ones.

    Args:
        first: (N, 4, 4) poses.
        second: (N, 4, 4) poses.

    Returns:
        (N, 6) rotation and translation (GTSAM's logarithm), and (N, 6, 6) their derivative by the second poses.
    """
    motion = [gtsam.Pose3(step) for step in invert(first) @ second]
    distance = np.array([gtsam.Pose3.Logmap(step) for step in motion]).reshape(-1, 6)
    jacobian = np.array([gtsam.Pose3.LogmapDerivative(vector) for vector in distance]).reshape(-1, 6, 6)
    return distance, jacobian


def _is_undecided(probability: float) -> bool:
    return MIN_UNDECIDED_PROBABILITY <= probability <= 1 - MIN_UNDECIDED_PROBABILITY


def _outer(vectors: FloatArray) -> FloatArray:
    return vectors[..., :, None] * vectors[..., None, :]


def _range_elevation_covariance(solution: Solution) -> float:
    """Return the covariance of range and elevation of the used observations: positive if far points lie higher."""
    tracks, used = solution.tracks, solution.observed
    if not used.any():
        return 0.0
    bundle = solution.bundle
    elevation_rad = observed_elevations(solution.problem, bundle.world_from_vehicle, bundle.xyz_m)[used]
    range_m = tracks.range_m[used]
    return float(np.mean((range_m - range_m.mean()) * elevation_rad))


def _mirrored_bundle(solution: Solution, mirror: Mirror) -> Bundle:
    """Return the bundle of the mirror image: the same measurements, aperture priors at its own elevations."""
    bundle = solution.bundle
    graph = bundle.measured.clone()
    add_aperture_priors(graph, solution.problem, mirror.world_from_vehicle, mirror.xyz_m)
    return replace(
        bundle,
        world_from_vehicle=mirror.world_from_vehicle,
        xyz_m=mirror.xyz_m,
        graph=graph,
        values=make_values(mirror.world_from_vehicle, mirror.xyz_m, bundle.in_graph),
    )
