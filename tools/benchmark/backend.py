"""Every number that the back-end is asked to reach on sequences with truth, in one table, for ``benchmark.py``.

Covariances are judged by the NEES e' C^-1 e / 3 of position and of attitude. The errors of the frames of one run hang
together, so that the mean over its frames counts as one draw of three degrees of freedom: with true covariances, the
mean over R runs lies between the 2.5 % and the 97.5 % quantile of a chi-square of 3 R degrees of freedom, over 3 R.
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
from tools.benchmark.frontend import Requirement
from tools.benchmark.simulated_cases import Case, provide_sequence

RATIO = {"navigation": 0.35, "odometry": 0.80}
WORST_RATIO = 1.0
OVER_BOUND = {"navigation": 1.6}
PATH_SHARE = {"sonar": 0.04}
RECORDINGS = {"oculus_tank_a": 0.030, "oculus_tank_b": 0.016}
"""Names of recordings with true poses, and the ATE in metres asked of the sonar alone."""
LOST = 0.10
"""ATE over the path beyond which a run has to say that it is not to be trusted."""
WELL_CONSTRAINED, NEAR, LANDMARK_M = 1 / 3, 0.95, 0.05
JUDGED = ("navigation",)
"""Modes whose covariances are judged."""
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Task:
    """One sequence to measure, in some modes."""

    sequence: Case | Path
    """To simulate, or a recording."""
    modes: tuple[str, ...]

    @property
    def narrow(self) -> bool:
        """Whether the frames overlap too little for the sonar alone."""
        return isinstance(self.sequence, Case) and self.sequence.speed_factor != 1


def list_tasks(
    cases: Sequence[Case], narrow: Sequence[Case], data: Path | None, modes: Sequence[str] = tuple(MODES)
) -> list[Task]:
    """List what to measure: the cases in all modes, the narrow ones and the recordings by the sonar alone."""
    tasks = [Task(case, tuple(modes)) for case in cases]
    if "sonar" in modes:
        tasks += [Task(case, ("sonar",)) for case in narrow]
        tasks += [Task(data / name, ("sonar",)) for name in RECORDINGS if data is not None]
    return tasks


def measure_tasks(
    tasks: Sequence[Task], cache: Path, settings: tuple[str, ...], bound: bool, jobs: int = 1
) -> Iterator[tuple[Task, Accuracy]]:
    """Measure all tasks, and give each run when it is done; with more than one job, in processes of their own.

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
        waiting = {pool.submit(_measure_all, task, cache, settings, bound): task for task in tasks}
        try:
            for done in as_completed(waiting):
                for run in done.result():
                    yield waiting[done], run
        finally:
            pool.shutdown(cancel_futures=True)


def _measure(task: Task, cache: Path, settings: tuple[str, ...], bound: bool) -> Iterator[Accuracy]:
    path = provide_sequence(task.sequence, cache) if isinstance(task.sequence, Case) else task.sequence
    return measure_sequence(path, task.modes, settings, bound)


def _measure_all(task: Task, cache: Path, settings: tuple[str, ...], bound: bool) -> list[Accuracy]:
    return list(_measure(task, cache, settings, bound))


def list_backend_numbers(runs: Sequence[tuple[Task, Accuracy]]) -> Iterator[Requirement]:
    """Set what the runs reach beside what is asked of them: means over the runs, and the worst of them by name."""
    yield Requirement("runs", float(len(runs)))
    yield Requirement("runs that failed", float(sum(1 for _, run in runs if run.failure)), at_most=0)
    whole = [(task, run) for task, run in runs if not run.failure]
    for mode in MODES:
        simulated = [
            run for task, run in whole if run.mode == mode and isinstance(task.sequence, Case) and not task.narrow
        ]
        if simulated:
            yield from _list_errors(mode, simulated)
            yield from _list_nees(mode, simulated)
            yield from _list_landmarks(mode, simulated)
    yield from _list_recognised([run for _, run in whole if run.mode == "sonar"])
    narrow = [run for task, run in whole if task.narrow]
    yield from _sum_up("narrow sonar alone, ATE / path", narrow, lambda run: run.path_share)
    for _, run in whole:
        if run.name in RECORDINGS:
            yield Requirement(f"{run.name}, sonar alone, ATE", run.ate_m, "m", at_most=RECORDINGS[run.name])


def _list_errors(mode: str, runs: Sequence[Accuracy]) -> Iterator[Requirement]:
    worst = WORST_RATIO if mode in RATIO else None
    yield from _sum_up(f"{mode}, ATE / odometry", runs, lambda run: run.ratio, RATIO.get(mode), worst)
    yield from _sum_up(f"{mode}, ATE / bound", runs, lambda run: run.over_bound, OVER_BOUND.get(mode))
    if mode in PATH_SHARE:
        yield from _sum_up(f"{mode}, ATE / path", runs, lambda run: run.path_share, PATH_SHARE[mode])


def _list_nees(mode: str, runs: Sequence[Accuracy]) -> Iterator[Requirement]:
    """Judge the covariances with navigation, and show what the others are worth."""
    low, high = nees_interval(max(sum(run.nees is not None for run in runs), 1)) if mode in JUDGED else (None, None)
    title = f"{mode}, NEES a degree of freedom"
    yield from _sum_up(f"{title}, position", runs, lambda run: run.nees and run.nees[0], high, at_least=low)
    yield from _sum_up(f"{title}, attitude", runs, lambda run: run.nees and run.nees[1], high, at_least=low)


def nees_interval(runs: int) -> tuple[float, float]:
    """Between which the mean NEES a degree of freedom over some runs lies in 95 % of all cases, one draw a run."""
    freedom = 3 * runs
    low, high = chi2.ppf([0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2], freedom) / freedom
    return float(low), float(high)


def _list_landmarks(mode: str, runs: Sequence[Accuracy]) -> Iterator[Requirement]:
    """Judge the landmarks of all runs together, and name the run whose own are worst."""
    found = {run.name: run.landmarks for run in runs if run.landmarks is not None}
    if not found:
        return
    title, pooled = f"{mode}, well-constrained landmarks", pool_landmarks(found.values())
    yield Requirement(f"{title}, share of all tracks", pooled.share, at_least=WELL_CONSTRAINED)
    yield from _name_worst(f"{title}, share of all tracks", {name: one.share for name, one in found.items()}, min)
    yield Requirement(f"{title}, share within 3 sigmas, of {len(pooled.error_m)}", pooled.near, at_least=NEAR)
    yield from _name_worst(f"{title}, share within 3 sigmas", {name: one.near for name, one in found.items()}, min)
    yield Requirement(f"{title}, median error", pooled.median_m, "m", at_most=LANDMARK_M)
    errors_m = {name: one.median_m for name, one in found.items()}
    yield from _name_worst(f"{title}, median error", errors_m, max, unit="m")


def _list_recognised(runs: Sequence[Accuracy]) -> Iterator[Requirement]:
    """Count who says that it is not to be trusted, of the runs that are lost and of the others."""
    for title, lost in ((f"ATE above {100 * LOST:.0f} % of the path", True), ("the others", False)):
        told = [run.distrusted for run in runs if (run.path_share > LOST) == lost]
        if told:
            share, asked = sum(told) / len(told), 1.0 if lost else None
            yield Requirement(f"sonar alone, {title}: share that says so, of {len(told)}", share, at_least=asked)


def _sum_up(
    title: str,
    runs: Sequence[Accuracy],
    pick: Callable[[Accuracy], float | None],
    at_most: float | None = None,
    worst_at_most: float | None = None,
    at_least: float | None = None,
) -> Iterator[Requirement]:
    """Give the mean of what is known of the runs, and the worst; nothing where nothing is known and nothing asked."""
    found = {run.name: pick(run) for run in runs}
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
    """Give the worst of the known values, with the run's name."""
    values = {name: value for name, value in found.items() if value is not None}
    if values:
        name = worst(values, key=lambda name: values[name])
        yield Requirement(f"{title}, worst: {name}", values[name], unit, at_most)
