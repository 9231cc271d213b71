"""Requirements on the back-end over sequences with truth: pose errors, covariances, landmarks, warnings.

Covariances are evaluated by the NEES e' C^-1 e / 3 of position and of attitude. The errors of the frames of one run are
correlated, so that their mean counts as one draw of three degrees of freedom: with true covariances, the mean over R
runs lies between the 2.5 % and the 97.5 % quantile of a chi-square of 3 R degrees of freedom, over 3 R.
"""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from asfm.evaluation.covariance_consistency import pool_landmarks
from tools.benchmark.accuracy import MODES, Accuracy, measure_sequence
from tools.benchmark.simulated_cases import Case, provide_sequence
from tools.benchmark.table import Requirement

MAX_MEAN_RATIO = {"navigation": 0.35, "odometry": 0.80}
"""ATE / odometry's ATE, by mode."""
MAX_RATIO = 1.0
MAX_OVER_BOUND = {"navigation": 1.6}
MAX_PATH_SHARE = {"sonar": 0.04}
MAX_RECORDING_ATE_M = {"oculus_tank_a": 0.030, "oculus_tank_b": 0.016}
"""Recordings with true poses, by the sonar alone."""
LOST_PATH_SHARE = 0.10
"""ATE over the path beyond which a run is lost and must be flagged as not to be trusted."""
MIN_WELL_CONSTRAINED, MIN_WITHIN_3_SIGMA, MAX_LANDMARK_ERROR_M = 1 / 3, 0.95, 0.05
NEES_MODES = ("navigation",)
"""Modes with requirements on their covariances."""
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Task:
    """One sequence to measure, in some modes."""

    sequence: Case | Path
    """A case to simulate, or the path of a recording."""
    modes: tuple[str, ...]

    @property
    def narrow(self) -> bool:
        """Whether this is a sequence of the narrow sonar, whose frames overlap too little for the sonar alone."""
        return isinstance(self.sequence, Case) and self.sequence.speed_factor != 1


def list_tasks(
    cases: Sequence[Case], narrow: Sequence[Case], data: Path | None, modes: Sequence[str] = tuple(MODES)
) -> list[Task]:
    """List the tasks: the cases in all modes, the narrow ones and the recordings by the sonar alone."""
    tasks = [Task(case, tuple(modes)) for case in cases]
    if "sonar" in modes:
        tasks += [Task(case, ("sonar",)) for case in narrow]
        tasks += [Task(data / name, ("sonar",)) for name in MAX_RECORDING_ATE_M if data is not None]
    return tasks


def measure_tasks(
    tasks: Sequence[Task], cache: Path, settings: tuple[str, ...], bound: bool, jobs: int = 1
) -> Iterator[tuple[Task, Accuracy]]:
    """Measure all tasks and yield each run when it is done; with more than one job, in processes of their own.

    Args:
        tasks: sequences and modes.
        cache: folder of the simulated sequences.
        settings: each as section.key=value.
        bound: measure the accuracy bound too.
        jobs: number of sequences measured at once.

    Raises:
        AsfmError: a sequence cannot be simulated or read.
    """
    if jobs == 1:
        for task in tasks:
            for run in _measure(task, cache, settings, bound):
                yield task, run
        return
    context = multiprocessing.get_context("spawn")  # libraries with threads do not survive a fork
    with ProcessPoolExecutor(jobs, mp_context=context) as pool:
        pending = {pool.submit(_measure_all, task, cache, settings, bound): task for task in tasks}
        try:
            for done in as_completed(pending):
                for run in done.result():
                    yield pending[done], run
        finally:
            pool.shutdown(cancel_futures=True)


def _measure(task: Task, cache: Path, settings: tuple[str, ...], bound: bool) -> Iterator[Accuracy]:
    path = provide_sequence(task.sequence, cache) if isinstance(task.sequence, Case) else task.sequence
    return measure_sequence(path, task.modes, settings, bound)


def _measure_all(task: Task, cache: Path, settings: tuple[str, ...], bound: bool) -> list[Accuracy]:
    return list(_measure(task, cache, settings, bound))


def list_backend_numbers(runs: Sequence[tuple[Task, Accuracy]]) -> Iterator[Requirement]:
    """List means over the runs and the worst run by name, beside what is required of them."""
    yield Requirement("runs", float(len(runs)))
    yield Requirement("runs that failed", float(sum(1 for _, run in runs if run.failure)), at_most=0)
    finished = [(task, run) for task, run in runs if not run.failure]
    for mode in MODES:
        simulated = [
            run for task, run in finished if run.mode == mode and isinstance(task.sequence, Case) and not task.narrow
        ]
        if simulated:
            yield from _list_errors(mode, simulated)
            yield from _list_nees(mode, simulated)
            yield from _list_landmarks(mode, simulated)
    yield from _list_flagged([run for _, run in finished if run.mode == "sonar"])
    narrow = [run for task, run in finished if task.narrow]
    yield from _summarise("narrow sonar alone, ATE / path", narrow, lambda run: run.path_share)
    for _, run in finished:
        if run.name in MAX_RECORDING_ATE_M:
            yield Requirement(f"{run.name}, sonar alone, ATE", run.ate_m, "m", at_most=MAX_RECORDING_ATE_M[run.name])


def _list_errors(mode: str, runs: Sequence[Accuracy]) -> Iterator[Requirement]:
    max_ratio = MAX_RATIO if mode in MAX_MEAN_RATIO else None
    yield from _summarise(f"{mode}, ATE / odometry", runs, lambda run: run.ratio, MAX_MEAN_RATIO.get(mode), max_ratio)
    yield from _summarise(f"{mode}, ATE / bound", runs, lambda run: run.over_bound, MAX_OVER_BOUND.get(mode))
    if mode in MAX_PATH_SHARE:
        yield from _summarise(f"{mode}, ATE / path", runs, lambda run: run.path_share, MAX_PATH_SHARE[mode])


def _list_nees(mode: str, runs: Sequence[Accuracy]) -> Iterator[Requirement]:
    """List the NEES, with requirements where navigation is used."""
    measured = max(sum(run.nees is not None for run in runs), 1)
    low, high = nees_interval(measured) if mode in NEES_MODES else (None, None)
    title = f"{mode}, NEES per degree of freedom"
    position, attitude = (
        lambda run: run.nees and run.nees.position,
        lambda run: run.nees and run.nees.attitude,
    )
    yield from _summarise(f"{title}, position", runs, position, high, at_least=low)
    yield from _summarise(f"{title}, attitude", runs, attitude, high, at_least=low)


def nees_interval(runs: int) -> tuple[float, float]:
    """Return the interval of the mean NEES per degree of freedom over some runs that holds 95 % of all means."""
    freedom = 3 * runs
    low, high = chi2.ppf([0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2], freedom) / freedom
    return float(low), float(high)


def _list_landmarks(mode: str, runs: Sequence[Accuracy]) -> Iterator[Requirement]:
    """List the consistency of the landmarks of all runs together, and the worst run by name."""
    found = {run.name: run.landmarks for run in runs if run.landmarks is not None}
    if not found:
        return
    title, pooled = f"{mode}, well-constrained landmarks", pool_landmarks(found.values())
    shares = {name: one.well_constrained_share for name, one in found.items()}
    within = {name: one.within_3_sigma for name, one in found.items()}
    errors_m = {name: one.median_error_m for name, one in found.items()}
    share, near, error = f"{title}, share of all tracks", f"{title}, share within 3 sigma", f"{title}, median error"
    yield Requirement(share, pooled.well_constrained_share, at_least=MIN_WELL_CONSTRAINED)
    yield from _name_worst(share, shares, min)
    yield Requirement(f"{near}, of {len(pooled.error_m)}", pooled.within_3_sigma, at_least=MIN_WITHIN_3_SIGMA)
    yield from _name_worst(near, within, min)
    yield Requirement(error, pooled.median_error_m, "m", at_most=MAX_LANDMARK_ERROR_M)
    yield from _name_worst(error, errors_m, max, unit="m")


def _list_flagged(runs: Sequence[Accuracy]) -> Iterator[Requirement]:
    """List the share of runs flagged as not to be trusted, of those that are lost and of the others."""
    for title, lost in ((f"ATE above {100 * LOST_PATH_SHARE:.0f} % of the path", True), ("the others", False)):
        flagged = [run.flagged for run in runs if (run.path_share > LOST_PATH_SHARE) == lost]
        if flagged:
            share, required = sum(flagged) / len(flagged), 1.0 if lost else None
            yield Requirement(f"sonar alone, {title}: share flagged, of {len(flagged)}", share, at_least=required)


def _summarise(
    title: str,
    runs: Sequence[Accuracy],
    measure: Callable[[Accuracy], float | None],
    at_most: float | None = None,
    worst_at_most: float | None = None,
    at_least: float | None = None,
) -> Iterator[Requirement]:
    """List the mean of a measure and the worst run; nothing where nothing is measured and nothing required."""
    found = {run.name: measure(run) for run in runs}
    values = [value for value in found.values() if value is not None]
    if values or at_most is not None:
        mean = float(np.mean(values)) if values else None
        yield Requirement(f"{title}, mean of {len(values)}", mean, "", at_most, at_least)
    yield from _name_worst(title, found, max, worst_at_most)


def _name_worst(
    title: str,
    found: dict[str, float | None],
    worst: Callable[..., str],
    at_most: float | None = None,
    unit: str = "",
) -> Iterator[Requirement]:
    """List the worst of the known values, with the run's name."""
    values = {name: value for name, value in found.items() if value is not None}
    if values:
        name = worst(values, key=lambda name: values[name])
        yield Requirement(f"{title}, worst: {name}", values[name], unit, at_most)
