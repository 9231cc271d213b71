"""The mirror image of a solution, which the sonar alone cannot tell from the solution itself.

Range and bearing stay the same when a scene is reflected at the sonar's plane. Reflect the scene at the plane of the
first frame, and every frame's pose along with it: all measurements of the sonar fit exactly as well as before. Heights,
rolls, pitches and elevations change their sign. Only what is not sonar decides: odometry, depth, attitude. (For the
affine camera the same is known as Necker's reversal.)
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
from asfm.geometry.poses import invert, transform
from asfm.types import FloatArray

REFLECTION = np.diag([1.0, 1.0, -1.0, 1.0])
EXCLUDED = 1e-6
"""An image less probable than this counts as excluded."""
UNDECIDED = 0.05
"""Where neither image is less probable than this, the measurements do not tell."""
FAR = 3.0
"""Sigmas that the images of a pose must lie apart for the difference to be worth a word."""


@dataclass(frozen=True)
class Mirror:
    """The other image of a solution."""

    probability: float
    """That this image is the true one, as the measurements say: 0.5 where they do not tell."""
    world_from_vehicle: FloatArray
    """(N, 4, 4), the first one as in the solution."""
    xyz_m: FloatArray
    """(T, 3)"""


def reflect(
    world_from_vehicle: FloatArray, xyz_m: FloatArray, vehicle_from_sonar: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Reflect (N, 4, 4) poses and (T, 3) points at the plane of the first frame's sonar, which stays where it is."""
    across = _reflect_at(world_from_vehicle[0] @ vehicle_from_sonar)
    return reflect_after(world_from_vehicle, 0, vehicle_from_sonar), transform(across, xyz_m)


def reflect_after(world_from_vehicle: FloatArray, frame: int, vehicle_from_sonar: FloatArray) -> FloatArray:
    """Reflect the poses (N, 4, 4) after a frame at the plane of its sonar."""
    sonars = world_from_vehicle @ vehicle_from_sonar
    turned = _reflect_at(sonars[frame]) @ sonars[frame + 1 :] @ REFLECTION @ invert(vehicle_from_sonar)
    return np.concatenate([world_from_vehicle[: frame + 1], turned])


def _reflect_at(world_from_sonar: FloatArray) -> FloatArray:
    """Give the (4, 4) that reflects the world at the plane of a sonar."""
    return np.asarray(world_from_sonar @ REFLECTION @ invert(world_from_sonar))


def find_mirror(solution: Solution, scene: Scene = "unknown") -> Mirror:
    """Reflect a solution and ask its measurements which of the two images is the true one.

    Args:
        solution: shows the image that :func:`choose_mirror` has chosen.
        scene: where it is known to lie, which excludes the image wherever the measurements do not tell.
    """
    bundle = solution.bundle
    poses, points = reflect(bundle.world_from_vehicle, bundle.xyz_m, solution.problem.vehicle_from_sonar)
    worse = bundle.measured.error(make_values(poses, points, bundle.in_graph)) - bundle.measured.error(bundle.values)
    probability = float(1 / (1 + np.exp(np.clip(worse, -500.0, 500.0))))
    if probability < EXCLUDED or (scene != "unknown" and _is_undecided(probability)):
        probability = 0.0
    return Mirror(probability, poses, points)


def choose_mirror(solution: Solution, scene: Scene = "unknown") -> Solution:
    """Take the other image where the measurements say so, or where they say nothing and it shows a bottom from above.

    In one of two images that are equally probable, what is near lies lower than what is far, as on a bottom that is
    seen from above; in the other one it lies higher, as on a hull that is seen from beneath. Sonars look at bottoms
    more often. That decides which image is shown, not how sure it is, unless the scene is known to lie there.

    Args:
        solution: either image.
        scene: below the sonar, or above it.
    """
    other = find_mirror(solution)
    slope = _rises_with_range(solution) * (-1 if scene == "above" else 1)
    take = slope < 0 if _is_undecided(other.probability) else other.probability > 0.5
    return replace(solution, bundle=_take(solution, other)) if take else solution


def inflate_for_mirror(uncertainty: Uncertainty, solution: Solution, mirror: Mirror) -> Uncertainty:
    """Widen the covariances of poses and points for the mirror image: their second moments over both images.

    With d from an estimate to its image, which has the probability p and the covariance C', the squared error about
    the estimate is expected to be (1 - p) C + p (C' + d d'). Spans are left as they are: they tell what holds one image
    together.
    """
    share = mirror.probability
    if not share:
        return uncertainty
    bundle, lever = solution.bundle, solution.problem.vehicle_from_sonar
    apart, carry = compare_poses(bundle.world_from_vehicle, mirror.world_from_vehicle)
    turned = carry @ _reflect_motions(lever)
    pose = turned @ uncertainty.pose @ np.swapaxes(turned, 1, 2) + _square(apart)
    across = _reflect_at(bundle.world_from_vehicle[0] @ lever)[:3, :3]
    known = np.isfinite(uncertainty.point_m2).all(axis=(1, 2))
    point_m2 = uncertainty.point_m2.copy()
    shift_m = mirror.xyz_m[known] - bundle.xyz_m[known]
    image_m2 = across @ point_m2[known] @ across + _square(shift_m)
    point_m2[known] = (1 - share) * point_m2[known] + share * image_m2
    pose = (1 - share) * uncertainty.pose + share * pose
    return replace(uncertainty, pose=(pose + np.swapaxes(pose, 1, 2)) / 2, point_m2=point_m2)


def _reflect_motions(vehicle_from_sonar: FloatArray) -> FloatArray:
    """Give the (6, 6) that turns a small motion in the vehicle's frame into that of its image.

    In the sonar's frame turns about x and y and shifts along z change their sign.
    """
    carry = gtsam.Pose3(vehicle_from_sonar).AdjointMap()
    return np.asarray(carry @ np.diag([-1.0, -1.0, 1.0, 1.0, 1.0, -1.0]) @ np.linalg.inv(carry))


def warn_of_mirror(uncertainty: Uncertainty, bundle: Bundle, mirror: Mirror) -> tuple[Diagnostic, ...]:
    """Say in a sentence that another image explains the measurements, where it is clearly another one.

    Args:
        uncertainty: within one image.
    """
    if not mirror.probability:
        return ()
    apart, _ = compare_poses(bundle.world_from_vehicle, mirror.world_from_vehicle)
    far = np.einsum("ni,nij,nj->n", apart, np.linalg.pinv(uncertainty.pose, hermitian=True), apart) > FAR**2
    if not far[1:].any():
        return ()
    turn_deg = float(np.rad2deg(np.abs(apart[:, :3]).max()))
    shift_m = float(np.linalg.norm(apart[:, 3:], axis=1).max())
    message = (
        f"the scene and its mirror image at the sonar's first plane explain the measurements alike (probability of the "
        f"image not shown: {mirror.probability:.2g}): heights, roll and pitch may have the other sign; up to "
        f"{turn_deg:.2g} deg and {shift_m:.2g} m lie between the two, and the sigmas include that; depth, attitude, "
        "odometry or backend.scene (below or above the sonar) would tell"
    )
    return (Diagnostic("mirror-ambiguity", message),)


def compare_poses(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Give the motions from poses (N, 4, 4) to others, in the first one's tangent space as covariances are.

    Returns:
        (N, 6) rotation and translation, GTSAM's logarithm; (N, 6, 6) how they change with small motions of the others.
    """
    motion = [gtsam.Pose3(step) for step in invert(first) @ second]
    apart = np.array([gtsam.Pose3.Logmap(step) for step in motion]).reshape(-1, 6)
    carry = np.array([gtsam.Pose3.LogmapDerivative(vector) for vector in apart]).reshape(-1, 6, 6)
    return apart, carry


def _is_undecided(probability: float) -> bool:
    return UNDECIDED <= probability <= 1 - UNDECIDED


def _square(vectors: FloatArray) -> FloatArray:
    return vectors[..., :, None] * vectors[..., None, :]


def _rises_with_range(solution: Solution) -> float:
    """Covariance of range and elevation over the used observations: positive where what is far lies higher."""
    tracks, used = solution.tracks, solution.observed
    if not used.any():
        return 0.0
    elevation_rad = observed_elevations(solution.problem, solution.bundle.world_from_vehicle, solution.bundle.xyz_m)[
        used
    ]
    range_m = tracks.range_m[used]
    return float(np.mean((range_m - range_m.mean()) * elevation_rad))


def _take(solution: Solution, mirror: Mirror) -> Bundle:
    """Make a bundle of the other image: its measurements are the same, and its points lie in the beam as well."""
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
