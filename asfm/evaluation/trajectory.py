"""Trajectory errors: rigid alignment, absolute (ATE) and relative (RPE) pose errors.

The scale is never estimated: a sonar measures ranges, so a wrong scale is an error.
"""

from dataclasses import dataclass

import numpy as np

from asfm.errors import AsfmError
from asfm.geometry.poses import interpolate, invert, make_pose
from asfm.sequence import Sequence
from asfm.types import FloatArray, IntArray

MIN_EXTENT_M = 1e-6
"""Positions with a smaller extent do not determine the rotation."""
MAX_STRAIGHT_RATIO = 1e-9
"""Second to first singular value of the positions' covariance up to which a path counts as a straight line."""


@dataclass(frozen=True)
class Statistics:
    """Summary statistics of a set of errors, in their unit."""

    rmse: float
    mean: float
    median: float
    max: float


def interpolate_groundtruth(sequence: Sequence) -> FloatArray:
    """Interpolate the true world_from_vehicle (N, 4, 4) at the stamps of the frames.

    Raises:
        AsfmError: the sequence has no true poses.
    """
    truth = sequence.groundtruth
    if truth is None:
        raise AsfmError(f"{sequence.name}: expected true poses, found none")
    return interpolate(truth.timestamps_s, truth.world_from_vehicle, sequence.timestamps_s)


def align_se3(estimate: FloatArray, reference: FloatArray) -> FloatArray:
    """Align positions by the least-squares rigid transform, scale fixed at one.

    Kabsch 1976, Umeyama 1991 without scale. Where the positions do not determine the rotation (a straight or a static
    path, two poses), the orientations do.

    Args:
        estimate: (N, 4, 4), N >= 1.
        reference: (N, 4, 4).

    Returns:
        (4, 4) reference_world_from_estimated_world.
    """
    from scipy.spatial.transform import Rotation  # slow to load

    estimate_mean, reference_mean = estimate[:, :3, 3].mean(axis=0), reference[:, :3, 3].mean(axis=0)
    estimate_m, reference_m = estimate[:, :3, 3] - estimate_mean, reference[:, :3, 3] - reference_mean
    left, singular_values, right = np.linalg.svd(reference_m.T @ estimate_m / len(estimate))
    if min(np.abs(estimate_m).max(), np.abs(reference_m).max()) < MIN_EXTENT_M:
        rotation = align_rotations(estimate, reference)
    elif singular_values[1] <= MAX_STRAIGHT_RATIO * singular_values[0]:
        rotation = align_rotations(estimate, reference, (right[0], left[:, 0]))
    else:
        handedness = np.sign(np.linalg.det(left) * np.linalg.det(right))
        rotation = left @ np.diag([1.0, 1.0, handedness]) @ right
    return make_pose(reference_mean - rotation @ estimate_mean, Rotation.from_matrix(rotation))


def align_first_pose(estimate: FloatArray, reference: FloatArray) -> FloatArray:
    """Return the (4, 4) transform that maps the first pose of (N, 4, 4) to the reference's first."""
    return np.asarray(reference[0] @ invert(estimate[0]))


def absolute_errors(estimate: FloatArray, reference: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute the errors of (N, 4, 4) poses in one world: translation_m (N,) and rotation_rad (N,)."""
    translation_m = np.linalg.norm(estimate[:, :3, 3] - reference[:, :3, 3], axis=1)
    return translation_m, _rotation_angle(invert(reference) @ estimate)


def relative_errors(
    estimate: FloatArray, reference: FloatArray, first: IntArray, last: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Compute the relative pose errors (Sturm et al. 2012), which need no alignment.

    Args:
        estimate: (N, 4, 4)
        reference: (N, 4, 4)
        first: (P,) pose at which each motion begins.
        last: (P,) pose at which it ends.

    Returns:
        Translation errors in m (P,) and rotation errors in rad (P,).
    """
    estimated_motion = invert(estimate[first]) @ estimate[last]
    true_motion = invert(reference[first]) @ reference[last]
    error = invert(true_motion) @ estimated_motion
    return np.linalg.norm(error[:, :3, 3], axis=1), _rotation_angle(error)


def pairs_by_step(count: int, step: int = 1) -> tuple[IntArray, IntArray]:
    """Pair every pose with the pose a number of steps later: first (P,), last (P,)."""
    first = np.arange(max(count - step, 0))
    return first, first + step


def pairs_by_distance(reference: FloatArray, distance_m: float) -> tuple[IntArray, IntArray]:
    """Pair every pose of (N, 4, 4) with the first pose at least a distance further along the path.

    Returns:
        First (P,) and last (P,); empty where the whole path is shorter or the distance is not positive.
    """
    along_m = np.concatenate([[0.0], np.cumsum(_steps_m(reference))])
    last = np.searchsorted(along_m, along_m + distance_m * (1 - 1e-9))
    first = np.flatnonzero((last < len(along_m)) & (distance_m > 0))
    return first, last[first]


def path_length_m(world_from_vehicle: FloatArray) -> float:
    """Return the length of the path through (N, 4, 4) poses."""
    return float(_steps_m(world_from_vehicle).sum())


def summarise(errors: FloatArray) -> Statistics:
    """Compute the statistics of (N,) errors, N >= 1."""
    return Statistics(
        rmse=float(np.sqrt(np.mean(np.square(errors)))),
        mean=float(np.mean(errors)),
        median=float(np.median(errors)),
        max=float(np.max(errors)),
    )


def _steps_m(poses: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1))


def _rotation_angle(pose: FloatArray) -> FloatArray:
    from scipy.spatial.transform import Rotation  # slow to load

    return np.asarray(Rotation.from_matrix(pose[:, :3, :3]).magnitude())


def stationary_error_m(reference: FloatArray) -> float:
    """Return the ATE of an estimate that never moves: the rms distance of (N, 4, 4) true positions from their mean."""
    positions_m = reference[:, :3, 3]
    return float(np.sqrt(((positions_m - positions_m.mean(axis=0)) ** 2).sum(axis=1).mean()))


def align_rotations(
    estimate: FloatArray, reference: FloatArray, line: tuple[FloatArray, FloatArray] | None = None
) -> FloatArray:
    """Align orientations by the least-squares rotation, whatever the positions (Wahba 1965).

    Args:
        estimate: (N, 4, 4), N >= 1.
        reference: (N, 4, 4).
        line: (3,) estimated and (3,) true direction of a line that is aligned exactly.

    Returns:
        (3, 3) reference_world_from_estimated_world.
    """
    from scipy.spatial.transform import Rotation  # slow to load

    targets = np.swapaxes(reference[:, :3, :3], 1, 2).reshape(-1, 3)
    sources = np.swapaxes(estimate[:, :3, :3], 1, 2).reshape(-1, 3)
    weights = np.ones(len(targets))
    if line is not None:
        sources, targets = np.vstack([line[0], sources]), np.vstack([line[1], targets])
        weights = np.concatenate([[np.inf], weights])
    rotation, _ = Rotation.align_vectors(targets, sources, weights=weights)
    return np.asarray(rotation.as_matrix())
