"""Whether a run's own sigmas are true: poses and landmarks against the truth, for ``benchmark.py``."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from asfm.evaluation.trajectory import align_first_pose
from asfm.evaluation.true_points import find_true_points
from asfm.geometry.poses import interpolate, invert, transform
from asfm.sequence import Sequence
from asfm.types import FloatArray, FrameTruth, Reconstruction

if TYPE_CHECKING:
    from asfm.backend.estimation.solution import Solution

FEWEST_NEAR = 2
"""Observations that must agree on a point before it counts as the true one of their track."""
SIGMAS = 3.0


@dataclass(frozen=True)
class LandmarkQuality:
    """What truth says of the landmarks that a run calls well constrained."""

    tracks: int
    """All tracks of the run."""
    called: int
    """Those whose landmarks are called well constrained."""
    error_m: FloatArray
    """(J,) distances from the truth of those that can be judged, as their true point is known."""
    sigma_m: FloatArray
    """(J,) their own sigmas."""

    @property
    def share(self) -> float | None:
        """So many of all tracks are called well constrained; None without any track."""
        return self.called / self.tracks if self.tracks else None

    @property
    def near(self) -> float | None:
        """So many of the judged ones lie within three of their sigmas of the truth; None without any."""
        return float(np.mean(self.error_m <= SIGMAS * self.sigma_m)) if len(self.error_m) else None

    @property
    def median_m(self) -> float | None:
        """Median distance of the judged ones from the truth; None without any."""
        return float(np.median(self.error_m)) if len(self.error_m) else None


def pool_landmarks(qualities: Iterable[LandmarkQuality]) -> LandmarkQuality:
    """Take the landmarks of many runs together."""
    parts = list(qualities)
    return LandmarkQuality(
        tracks=sum(part.tracks for part in parts),
        called=sum(part.called for part in parts),
        error_m=np.concatenate([np.zeros(0), *(part.error_m for part in parts)]),
        sigma_m=np.concatenate([np.zeros(0), *(part.sigma_m for part in parts)]),
    )


def true_poses(sequence: Sequence) -> FloatArray:
    """Give the true world_from_vehicle (N, 4, 4) at the frames' stamps."""
    assert sequence.groundtruth is not None, "every sequence of the benchmark knows its true poses"
    return interpolate(
        sequence.groundtruth.timestamps_s, sequence.groundtruth.world_from_vehicle, sequence.timestamps_s
    )


def measure_nees(
    solution: "Solution", truth: FloatArray, stated: FloatArray | None = None
) -> tuple[float, float] | None:
    """Set the errors of position and attitude over their covariances: e' C^-1 e / 3, mean over frames.

    Errors are taken in the tangent space at the estimate (GTSAM's: rotation first, then translation, vehicle's frame).
    The first pose is left out: it is held, and every covariance counts from there.

    Args:
        solution: its graph gives the covariances.
        truth: (N, 4, 4) true poses in the same world, or with the same first pose where there is none.
        stated: (N, 6, 6) covariances to judge in the place of the graph's own: those of the run's reconstruction, which
            count in that the scene may be mirrored.

    Returns:
        position's and attitude's, both 1 where covariances are true; None where the graph cannot be factorised.
    """
    import gtsam

    from asfm.backend.graph.problem import FIRST_POSE

    bundle = solution.bundle
    squares = []
    try:
        marginals = gtsam.Marginals(bundle.graph, bundle.values)
        for frame in range(1, len(truth)):
            covariance = marginals.marginalCovariance(FIRST_POSE + frame) if stated is None else stated[frame]
            error = gtsam.Pose3(bundle.world_from_vehicle[frame]).localCoordinates(gtsam.Pose3(truth[frame]))
            squares.append([_normalise(error[part], covariance[part, part]) for part in (slice(3, 6), slice(0, 3))])
    except RuntimeError:
        return None
    position, attitude = np.mean(squares, axis=0) / 3
    return float(position), float(attitude)


def _normalise(error: FloatArray, covariance: FloatArray) -> float:
    return float(error @ np.linalg.solve(covariance, error))


def judge_landmarks(
    result: Reconstruction, sequence: Sequence, read_truth: Callable[[int], FrameTruth], aligned: bool
) -> LandmarkQuality:
    """Hold the landmarks that are called well constrained against the true points of their tracks.

    Args:
        aligned: the run has a world of its own. Its first pose is laid on the true one, as every sigma counts from
            there; aligned by positions alone, a straight path would let the landmarks turn about it.
    """
    poses, landmarks = true_poses(sequence), result.landmarks
    truth = find_true_points(result.tracks, sequence.sonar, invert(poses @ sequence.vehicle_from_sonar), read_truth)
    agreed = np.bincount(result.tracks.track, truth.near, minlength=result.tracks.count) >= FEWEST_NEAR
    true_from_estimate = align_first_pose(result.trajectory.world_from_vehicle, poses) if aligned else np.eye(4)
    judged = landmarks.well_constrained & (truth.known & agreed)[landmarks.track]
    error_m = np.linalg.norm(
        transform(true_from_estimate, landmarks.xyz_m[judged]) - truth.xyz_m[landmarks.track[judged]], axis=1
    )
    called = int(landmarks.well_constrained.sum())
    return LandmarkQuality(result.tracks.count, called, error_m, landmarks.sigma_m[judged])
