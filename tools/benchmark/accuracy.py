"""Accuracy of the back-end on one sequence: pose errors, consistency of covariances and landmarks."""

import time
from collections.abc import Callable, Iterator
from collections.abc import Sequence as Rows
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asfm.config import Config
from asfm.config_file import load_config
from asfm.datasets import open_sequence, open_truth
from asfm.evaluation.accuracy_bound import measure_bound
from asfm.evaluation.covariance_consistency import LandmarkConsistency, Nees, measure_landmarks, measure_nees
from asfm.evaluation.mirror_image import ATE_RMSE_MIRRORED, add_mirror_image
from asfm.evaluation.pose_error_table import ATE_RMSE, evaluate_sequence
from asfm.evaluation.trajectory import align_first_pose, interpolate_groundtruth, path_length_m
from asfm.navigation.frame_navigation import FrameNavigation, read_navigation
from asfm.navigation.pose_prediction import predict_poses
from asfm.pipeline.feature_matching import extract_matches
from asfm.pipeline.noise_estimation import estimate_noise
from asfm.pipeline.reconstruction import estimate
from asfm.pipeline.summary import summarise
from asfm.recorder import NullRecorder
from asfm.sequence import Sequence
from asfm.stages import StageClock
from asfm.types import FloatArray, FrameTruth, Keypoints, Matches, Reconstruction
from tools.benchmark.runs import SONAR_ALONE

MODES: dict[str, tuple[str, ...]] = {
    "navigation": (),
    "odometry": ("backend.use_navigation=false",),
    "sonar": SONAR_ALONE,
}
"""Settings of each mode: with odometry, depth and attitude; with odometry; with the sonar alone."""
UNCERTAIN = "position-uncertainty"
"""Code of the diagnostic that names the frame from which on the positions are too uncertain to be trusted."""


@dataclass(frozen=True)
class EvaluatedSequence:
    """One sequence with its truth."""

    name: str
    sequence: Sequence
    read_truth: Callable[[int], FrameTruth] | None
    """Returns the true elevations of a frame; None for a recording."""


@dataclass(frozen=True)
class Accuracy:
    """One run beside the truth."""

    name: str
    """Of the sequence."""
    mode: str
    """Key of :data:`MODES`."""
    failure: str = ""
    """The exception of a run that failed; the other fields are then defaults."""
    wall_s: float = 0.0
    """Of the back-end: from candidate matches to landmarks."""
    ate_m: float = np.inf
    """RMSE after SE(3) alignment, scale off."""
    path_m: float = 1.0
    odometry_ate_m: float | None = None
    bound_m: float | None = None
    nees: Nees | None = None
    landmarks: LandmarkConsistency | None = None
    flagged: bool = False
    """Whether the run's diagnostics say from which frame on its trajectory is not to be trusted."""

    @property
    def ratio(self) -> float | None:
        """ATE / odometry's ATE; None where no odometry is used."""
        return None if not self.odometry_ate_m or self.mode == "sonar" else self.ate_m / self.odometry_ate_m

    @property
    def over_bound(self) -> float | None:
        """ATE / bound; None where it was not measured."""
        return self.ate_m / self.bound_m if self.bound_m else None

    @property
    def path_share(self) -> float:
        """ATE / length of the true path."""
        return self.ate_m / self.path_m


def measure_sequence(path: Path, modes: Rows[str], settings: tuple[str, ...], bound: bool) -> Iterator[Accuracy]:
    """Run one sequence in each of the modes.

    Modes with the same predicted poses share one pass of the front-end, as its matches are the same.

    Args:
        path: folder or file of the sequence.
        modes: keys of :data:`MODES`.
        settings: each as section.key=value.
        bound: measure the accuracy bound of simulated sequences too.

    Raises:
        AsfmError: the sequence cannot be read.
    """
    test = EvaluatedSequence(path.name, open_sequence(path), open_truth(path))
    passes: list[tuple[FloatArray | None, list[Keypoints], list[Matches]]] = []
    for mode in modes:
        config = load_config(None, (*settings, *MODES[mode]))
        navigation = read_navigation(test.sequence, config.backend)
        prediction = predict_poses(navigation, test.sequence)
        poses = None if prediction is None else prediction.world_from_sonar
        found = [(keypoints, matches) for other, keypoints, matches in passes if _are_equal(poses, other)]
        config = estimate_noise(test.sequence, config, StageClock())
        if not found:
            found = [extract_matches(test.sequence, config, NullRecorder(), StageClock(), prediction)]
            passes.append((poses, *found[0]))
        try:
            result, wall_s = _run_backend(test.sequence, navigation, *found[0], config)
            yield _compare(test, mode, result, wall_s, config, bound)
        except Exception as error:  # a failed run is a row of the table, not its end
            yield Accuracy(test.name, mode, failure=" ".join(f"{type(error).__name__}: {error}".split()))


def _are_equal(one: FloatArray | None, other: FloatArray | None) -> bool:
    return one is other if one is None or other is None else np.array_equal(one, other)


def _run_backend(
    sequence: Sequence,
    navigation: FrameNavigation,
    keypoints: list[Keypoints],
    matches: list[Matches],
    config: Config,
) -> tuple[Reconstruction, float]:
    """Do what the pipeline does after its front-end, and return its wall time in seconds."""
    clock, begin_s = StageClock(), time.perf_counter()
    calibrated, solution, diagnostics = estimate(sequence, navigation, keypoints, matches, config, clock)
    result = summarise(calibrated, solution, config, clock, diagnostics)
    return result, time.perf_counter() - begin_s


def _compare(
    test: EvaluatedSequence, mode: str, result: Reconstruction, wall_s: float, config: Config, with_bound: bool
) -> Accuracy:
    """Compare a result with the truth.

    The world of a run by the sonar alone is its own: its first pose is laid on the true one, as every sigma is relative
    to it. Its pose error is that of the nearer of the run and its mirror image, between which the sonar cannot tell.
    """
    sequence, read_truth, truth = test.sequence, test.read_truth, interpolate_groundtruth(test.sequence)
    poses = result.trajectory.world_from_vehicle
    true_from_estimate = align_first_pose(poses, truth) if mode == "sonar" else np.eye(4)
    table = evaluate_sequence(sequence, result.trajectory)
    row = table.row(ATE_RMSE)
    ate_m = row.value
    if mode == "sonar":
        ate_m = min(ate_m, add_mirror_image(table, sequence, result.trajectory).row(ATE_RMSE_MIRRORED).value)
    bound, landmarks = None, None
    if read_truth is not None:
        landmarks = measure_landmarks(result.landmarks, result.tracks, sequence, read_truth, true_from_estimate)
        if with_bound:
            bound = measure_bound(sequence, read_truth, result.tracks, result.observed, config).ate_m
    return Accuracy(
        test.name,
        mode,
        wall_s=wall_s,
        ate_m=ate_m,
        path_m=path_length_m(truth),
        odometry_ate_m=row.odometry,
        bound_m=bound,
        nees=measure_nees(true_from_estimate @ poses, truth, result.pose_covariance),
        landmarks=landmarks,
        flagged=any(item.code == UNCERTAIN for item in result.diagnostics),
    )


def describe_accuracy(run: Accuracy) -> str:
    """Return all numbers of one run in a line."""
    title = f"{run.name}, {run.mode}"
    if run.failure:
        return f"{title}: failed: {run.failure}"
    parts = [f"ATE {run.ate_m:.4f} m", f"{100 * run.path_share:.2f} % of the path"]
    for value, what in ((run.ratio, "of the odometry's"), (run.over_bound, "of the bound")):
        parts += [f"{value:.2f} {what}"] if value is not None else []
    if run.nees is not None:
        parts.append(f"NEES {run.nees.position:.2f}, {run.nees.attitude:.2f}")
    if run.landmarks is not None:
        found = run.landmarks
        parts.append(f"{found.well_constrained} of {found.tracks} tracks well constrained")
        if found.within_3_sigma is not None and found.median_error_m is not None:
            parts.append(
                f"{100 * found.within_3_sigma:.0f} % within 3 sigma, median error {found.median_error_m:.3f} m"
            )
    parts += ["flagged as not to be trusted"] if run.flagged else []
    return f"{title}: {'; '.join([*parts, f'{run.wall_s:.0f} s'])}"
