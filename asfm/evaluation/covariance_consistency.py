"""Consistency of a run's covariances: NEES of positions and attitudes, and landmark errors against their sigmas."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from asfm.evaluation.association import within_reach
from asfm.evaluation.evaluation_table import EvaluationRow
from asfm.evaluation.trajectory import align_first_pose, interpolate_groundtruth
from asfm.evaluation.true_points import find_true_points
from asfm.geometry.poses import invert, pose_log, transform
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, FrameTruth, IntArray, Tracks

MIN_INLIERS = 2
"""Observations that must agree with a true point before it counts as that of their track."""
MAX_ERROR_SIGMAS = 3.0
"""Errors up to this many sigmas agree with the covariance."""


class PointEstimates(Protocol):
    """Estimated points: a reconstruction's landmarks, or those read from its files."""

    @property
    def track(self) -> IntArray:
        """(L,) the track of each point."""

    @property
    def xyz_m(self) -> FloatArray:
        """(L, 3) in the run's world."""

    @property
    def sigma_m(self) -> FloatArray:
        """(L,) largest standard deviation."""

    @property
    def well_constrained(self) -> BoolArray:
        """(L,) whether the motion determines the elevation."""


@dataclass(frozen=True)
class Nees:
    """Normalised estimation error squared over its degrees of freedom, mean over frames: 1 where covariances are true.

    Bar-Shalom, Li and Kirubarajan 2001, Estimation with Applications to Tracking and Navigation, section 5.4.
    """

    position: float
    attitude: float


@dataclass(frozen=True)
class LandmarkConsistency:
    """Errors of the landmarks that a run calls well constrained."""

    tracks: int
    """All tracks of the run."""
    well_constrained: int
    """Those with a well-constrained landmark."""
    error_m: FloatArray
    """(J,) distances from the truth of the well-constrained landmarks whose true point is known."""
    sigma_m: FloatArray
    """(J,) sigmas that the run states for them."""

    @property
    def well_constrained_share(self) -> float | None:
        """Well-constrained landmarks over all tracks; None without tracks."""
        return self.well_constrained / self.tracks if self.tracks else None

    @property
    def within_3_sigma(self) -> float | None:
        """Share of the errors within three sigmas; None without errors."""
        return float(np.mean(self.error_m <= MAX_ERROR_SIGMAS * self.sigma_m)) if len(self.error_m) else None

    @property
    def median_error_m(self) -> float | None:
        """Median of the errors; None without errors."""
        return float(np.median(self.error_m)) if len(self.error_m) else None


def measure_nees(estimate: FloatArray, truth: FloatArray, covariance: FloatArray) -> Nees | None:
    """Compute the NEES e' C^-1 e / 3 of position and of attitude, mean over the frames but the first.

    The first pose is left out: it is held, and every covariance is relative to it.

    Args:
        estimate: (N, 4, 4) world_from_vehicle.
        truth: (N, 4, 4) true poses in the same world, or with the same first pose where there is none.
        covariance: (N, 6, 6) in the tangent space at the estimate: rotation in rad, then translation in m, in the
            vehicle's frame, as GTSAM's ``Pose3.localCoordinates``.

    Returns:
        None with fewer than two frames, and where a covariance is not finite or singular.
    """
    if len(estimate) < 2 or not np.isfinite(covariance[1:]).all():
        return None
    error = pose_log(invert(estimate[1:]) @ truth[1:])
    try:
        attitude, position = (
            np.mean(_squared_mahalanobis(error[:, part], covariance[1:, part, part])) / 3
            for part in (slice(0, 3), slice(3, 6))
        )
    except np.linalg.LinAlgError:
        return None
    return Nees(float(position), float(attitude))


def measure_landmarks(
    landmarks: PointEstimates,
    tracks: Tracks,
    sequence: Sequence,
    read_truth: Callable[[int], FrameTruth],
    true_from_estimate: FloatArray | None = None,
) -> LandmarkConsistency:
    """Compare the well-constrained landmarks with the true points of their tracks.

    Args:
        landmarks: of a run.
        tracks: (O,) observations that they were made from.
        sequence: sonar and true poses.
        read_truth: returns the true elevations of a frame.
        true_from_estimate: (4, 4) maps the run's world to the true one; None where they are the same.

    Raises:
        AsfmError: the sequence has no true poses, or the truth of a frame cannot be read.
    """
    sonar_from_world = invert(interpolate_groundtruth(sequence) @ sequence.vehicle_from_sonar)
    truth = find_true_points(tracks, sequence.sonar, sonar_from_world, read_truth)
    agreed = np.bincount(tracks.track, truth.inlier, minlength=tracks.count) >= MIN_INLIERS
    chosen = landmarks.well_constrained & (truth.known & agreed)[landmarks.track]
    aligned_m = transform(np.eye(4) if true_from_estimate is None else true_from_estimate, landmarks.xyz_m[chosen])
    error_m = np.linalg.norm(aligned_m - truth.xyz_m[landmarks.track[chosen]], axis=1)
    return LandmarkConsistency(tracks.count, int(landmarks.well_constrained.sum()), error_m, landmarks.sigma_m[chosen])


def pool_landmarks(parts: Iterable[LandmarkConsistency]) -> LandmarkConsistency:
    """Put the landmarks of many runs together."""
    parts = list(parts)
    return LandmarkConsistency(
        tracks=sum(part.tracks for part in parts),
        well_constrained=sum(part.well_constrained for part in parts),
        error_m=np.concatenate([np.zeros(0), *(part.error_m for part in parts)]),
        sigma_m=np.concatenate([np.zeros(0), *(part.sigma_m for part in parts)]),
    )


def evaluate_consistency(
    world_from_vehicle: FloatArray,
    pose_covariance: FloatArray,
    landmarks: PointEstimates,
    tracks: Tracks,
    sequence: Sequence,
    read_truth: Callable[[int], FrameTruth] | None,
    own_world: bool,
) -> tuple[EvaluationRow, ...]:
    """Evaluate the covariances of a run for a table: NEES from true poses, landmarks from a simulation's elevations.

    Args:
        world_from_vehicle: (N, 4, 4) one pose a frame of the sequence.
        pose_covariance: (N, 6, 6) as in :func:`measure_nees`.
        landmarks: of the run.
        tracks: (O,) observations that they were made from.
        sequence: sonar and true poses.
        read_truth: returns the true elevations of a frame; None for a recording.
        own_world: the run's world is not that of the true poses. Its first pose is then laid on the true one, to which
            every covariance is relative; an alignment of all positions would leave a rotation about a straight path.

    Returns:
        Rows ``nees_position``, ``nees_attitude``, ``landmarks_well_constrained_share``, ``landmarks_within_3_sigma``
        and ``landmark_error_median_m``; those that cannot be measured are missing.

    Raises:
        AsfmError: the truth of a frame cannot be read.
    """
    if sequence.groundtruth is None or not len(sequence):
        return ()
    truth = interpolate_groundtruth(sequence)
    covered = within_reach(sequence.timestamps_s, sequence.groundtruth.timestamps_s)
    if not covered[0]:
        return ()
    true_from_estimate = align_first_pose(world_from_vehicle, truth) if own_world else np.eye(4)
    estimate = true_from_estimate @ world_from_vehicle[covered]
    rows = _list_nees(measure_nees(estimate, truth[covered], pose_covariance[covered]))
    if read_truth is not None:
        rows += _list_landmarks(measure_landmarks(landmarks, tracks, sequence, read_truth, true_from_estimate))
    return tuple(rows)


def _list_nees(nees: Nees | None) -> list[EvaluationRow]:
    if nees is None:
        return []
    return [
        EvaluationRow("nees_position", "NEES of the positions, per degree of freedom", nees.position, ""),
        EvaluationRow("nees_attitude", "NEES of the attitudes, per degree of freedom", nees.attitude, ""),
    ]


def _list_landmarks(found: LandmarkConsistency) -> list[EvaluationRow]:
    name = "well-constrained landmarks"
    measures = (
        ("landmarks_well_constrained_share", f"{name} over all tracks", found.well_constrained_share, ""),
        ("landmarks_within_3_sigma", f"{name} within 3 sigma of the truth", found.within_3_sigma, ""),
        ("landmark_error_median_m", f"{name}, median error", found.median_error_m, "m"),
    )
    return [EvaluationRow(key, name, value, unit) for key, name, value, unit in measures if value is not None]


def _squared_mahalanobis(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return e' C^-1 e (N,) of errors (N, 3) and covariances (N, 3, 3)."""
    return np.asarray(np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0]))
