"""One run of the back-end beside the truth: poses, their covariances and landmarks, for ``benchmark.py``."""

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
from asfm.evaluation.covariance_consistency import LandmarkQuality, judge_landmarks, measure_nees, true_poses
from asfm.evaluation.pose_error_table import evaluate_sequence
from asfm.evaluation.trajectory import align_first_pose, path_length_m
from asfm.pipeline.reconstruction import estimate, extract_matches, predict_poses, summarise
from asfm.recorder import NullRecorder
from asfm.sequence import Sequence
from asfm.stages import StageClock
from asfm.types import FloatArray, FrameTruth, Keypoints, Matches
from tools.benchmark.runs import ATE, SONAR_ALONE

MODES: dict[str, tuple[str, ...]] = {
    "navigation": (),
    "odometry": ("backend.use_navigation=false",),
    "sonar": SONAR_ALONE,
}
"""What a run may use of the sequence, as settings: odometry, depth and attitude; odometry; the sonar alone."""
UNCERTAIN = "position-uncertainty"
"""Code of the diagnostic that names the frame from which on the positions are too uncertain to be trusted."""


@dataclass(frozen=True)
class Accuracy:
    """One run beside the truth."""

    name: str
    mode: str
    failure: str = ""
    """Why there is no result; what follows is then empty."""
    wall_s: float = 0.0
    """Of the back-end: from candidate matches to landmarks."""
    ate_m: float = np.inf
    """RMSE after SE(3) alignment, scale off."""
    path_m: float = 1.0
    odometry_ate_m: float | None = None
    bound_m: float | None = None
    nees: tuple[float, float] | None = None
    """Of position and attitude, a degree of freedom: mean over the frames but the first. None where the graph
    cannot be factorised."""
    landmarks: LandmarkQuality | None = None
    distrusted: bool = False
    """Whether the run says from which frame on its trajectory is not to be trusted."""

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

    The front-end is passed once for all modes that predict the same poses to it, as it makes the same matches of them.

    Raises:
        AsfmError: the sequence cannot be read.
    """
    sequence, read_truth = open_sequence(path), open_truth(path)
    passed: list[tuple[FloatArray | None, list[Keypoints], list[Matches]]] = []
    for mode in modes:
        config = load_config(None, (*settings, *MODES[mode]))
        predicted = predict_poses(sequence, config)
        poses = None if predicted is None else predicted.world_from_sonar
        found = [(keypoints, matches) for other, keypoints, matches in passed if _same(poses, other)]
        if not found:
            found = [extract_matches(sequence, config, NullRecorder(), StageClock())]
            passed.append((poses, *found[0]))
        try:
            yield _measure_run(path.name, mode, sequence, read_truth, *found[0], config, bound)
        except Exception as error:  # a run that breaks is a line of the table, not the end of it
            yield Accuracy(path.name, mode, failure=" ".join(f"{type(error).__name__}: {error}".split()))


def _same(one: FloatArray | None, other: FloatArray | None) -> bool:
    return one is other if one is None or other is None else np.array_equal(one, other)


def _measure_run(
    name: str,
    mode: str,
    sequence: Sequence,
    read_truth: Callable[[int], FrameTruth] | None,
    keypoints: list[Keypoints],
    candidates: list[Matches],
    config: Config,
    with_bound: bool,
) -> Accuracy:
    """Do what the pipeline does after its front-end, and hold it against the truth."""
    clock, begin_s = StageClock(), time.perf_counter()
    solved, solution, told = estimate(sequence, keypoints, candidates, config, clock)
    result = summarise(solved, solution, config, clock, told)
    wall_s = time.perf_counter() - begin_s
    truth = true_poses(sequence)
    poses = result.trajectory.world_from_vehicle
    row = evaluate_sequence(sequence, result.trajectory).row(ATE)
    bound = None
    if with_bound and read_truth is not None:
        bound = measure_bound(sequence, read_truth, result.tracks, result.observed, config).ate_m
    return Accuracy(
        name,
        mode,
        wall_s=wall_s,
        ate_m=row.value,
        path_m=path_length_m(truth),
        odometry_ate_m=row.odometry,
        bound_m=bound,
        nees=measure_nees(
            solution,
            align_first_pose(truth, poses) @ truth if mode == "sonar" else truth,
            result.pose_covariance,
        ),
        landmarks=None if read_truth is None else judge_landmarks(result, sequence, read_truth, mode == "sonar"),
        distrusted=any(item.code == UNCERTAIN for item in result.diagnostics),
    )


def describe_accuracy(run: Accuracy) -> str:
    """Tell everything about one run in a line."""
    title = f"{run.name}, {run.mode}"
    if run.failure:
        return f"{title}: failed: {run.failure}"
    parts = [f"ATE {run.ate_m:.4f} m", f"{100 * run.path_share:.2f} % of the path"]
    for value, what in ((run.ratio, "of the odometry's"), (run.over_bound, "of the bound")):
        parts += [f"{value:.2f} {what}"] if value is not None else []
    if run.nees is not None:
        parts.append("NEES {:.2f}, {:.2f}".format(*run.nees))
    if run.landmarks is not None:
        quality = run.landmarks
        parts.append(f"{quality.called} of {quality.tracks} tracks well constrained")
        if quality.near is not None and quality.median_m is not None:
            parts.append(f"{100 * quality.near:.0f} % near, {quality.median_m:.3f} m off")
    parts += ["not to be trusted by its own word"] if run.distrusted else []
    return f"{title}: {'; '.join([*parts, f'{run.wall_s:.0f} s'])}"
