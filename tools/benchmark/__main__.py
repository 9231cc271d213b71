"""Measure stages against independent implementations of the same, and whole runs against the truth.

``python -m tools.benchmark all``, or the name of one comparison, times stages side by side in one process. Contenders
take turns, so that a busy machine slows all of them alike; what counts is the ratio of the medians, and whether the
results agree.
``python -m tools.benchmark frontend [DATA_FOLDER]`` sets every number that the front-end is asked to reach beside what
it reaches: its stages, the time of a frame over that of A-KAZE alone, and the matches beside the truth.
``python -m tools.benchmark rates [DATA_FOLDER]`` counts the false alarms of CFAR on noise and in recorded empty water.
``python -m tools.benchmark backend [DATA_FOLDER]`` does the same for the back-end, over simulated sequences (and the
recordings with true poses where their folder is given): means, worst cases, covariances against the truth.
``python -m tools.benchmark backend-speed`` times its adjustment against factors in Python, and over a long sequence.
``python -m tools.benchmark run SEQUENCE [--set SECTION.KEY=VALUE]...`` measures one ``asfm run`` in a child process.
``python -m tools.benchmark public DATA_FOLDER`` measures the public recordings one after the other, in one table.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

from asfm.config_file import load_config
from asfm.errors import AsfmError
from tools.benchmark.accuracy import MODES, describe_accuracy
from tools.benchmark.backend import list_backend_numbers, list_tasks, measure_tasks
from tools.benchmark.false_alarm_rates import list_rates
from tools.benchmark.frontend import SEQUENCES, Requirement, list_numbers, tabulate
from tools.benchmark.kernels import COMPARISONS, Comparison, choose_comparisons, time_in_turns
from tools.benchmark.long_sequence import BATCH_FRAMES, BATCH_OBSERVATIONS, list_batch_numbers
from tools.benchmark.native_factors import compare_factors
from tools.benchmark.runs import RunFailed, describe_run, measure_run, tabulate_public
from tools.benchmark.simulated_cases import SEEN, SONARS, list_cases, list_narrow_cases

CLOCKS: dict[str, Callable[[], float]] = {"wall": time.perf_counter, "processor": time.process_time}
"""On a machine shared with others the processor's time is the fairer: what takes long is interrupted more often."""


def report(comparison: Comparison, rounds: int, clock: Callable[[], float] = time.perf_counter) -> bool:
    """Print the medians, their ratios and whether the results agree; returns whether all of them do."""
    expected, agree = comparison.ours(), True
    print(comparison.title)
    medians = time_in_turns({"asfm": comparison.ours, **comparison.peers}, rounds, clock)
    print(f"  {'asfm':<26}{1e3 * medians['asfm']:>10.2f} ms")
    for name, run in comparison.peers.items():
        different = 1 - float(np.mean(np.isclose(expected, run(), atol=1e-6)))
        agree &= different <= comparison.tolerance
        verdict = f"{100 * different:.4g} % of the results differ" if different else "same results"
        print(f"  {name:<26}{1e3 * medians[name]:>10.2f} ms   {medians[name] / medians['asfm']:.1f} x   {verdict}")
    return agree


def main(arguments: list[str] | None = None) -> int:
    """Run what the command line names; returns 1 where results disagree, a number is missed or a run fails."""
    options = make_parser().parse_args(arguments)
    if options.what == "run":
        return _report_run(options)
    if options.what == "rates":
        for line in list_rates(options.data, options.images):
            print(line, flush=True)
        return 0
    if options.what == "public":
        lines, all_ran = tabulate_public(options.data, options.recording)
        print("\n".join(lines))
        return 0 if all_ran else 1
    if options.what == "backend":
        return _report_backend(options)
    if options.what == "backend-speed":
        return _show_table([*compare_factors(), *list_batch_numbers(options.frames, options.observations)])
    cv2.setNumThreads(options.threads)
    if options.what == "frontend":
        return _report_frontend(options)
    names = choose_comparisons(options.what)
    clock, shape = CLOCKS[options.clock], tuple(options.shape)
    agree = [report(COMPARISONS[name](shape, options.seed), options.rounds, clock) for name in names]
    return 0 if all(agree) else 1


def make_parser() -> argparse.ArgumentParser:
    """Make the parser: one sub-command for each comparison and for all of them, for a run, for the public runs."""
    parser = argparse.ArgumentParser(prog="python -m tools.benchmark", description=(__doc__ or "").splitlines()[0])
    commands = parser.add_subparsers(dest="what", required=True, metavar="WHAT")
    for name in (*COMPARISONS, "all"):
        command = commands.add_parser(name, help="every comparison" if name == "all" else f"compare {name}")
        command.add_argument("--shape", type=int, nargs=2, default=(600, 256), metavar=("RANGES", "BEAMS"))
        command.add_argument("--seed", type=int, default=0)
        _add_timing(command)
    frontend = commands.add_parser("frontend", help="what the front-end is asked to reach, in one table")
    frontend.add_argument("data", type=Path, nargs="?", metavar="DATA_FOLDER")
    frontend.add_argument("--sequences", nargs="+", default=SEQUENCES, metavar="NAME", help="folders below DATA_FOLDER")
    _add_timing(frontend)
    backend = commands.add_parser("backend", help="what the back-end is asked to reach, in one table")
    _add_sequences(backend)
    speed = commands.add_parser("backend-speed", help="the adjustment against factors in Python; a long sequence")
    speed.add_argument("--frames", type=int, default=BATCH_FRAMES, help="of the long sequence")
    speed.add_argument("--observations", type=int, default=BATCH_OBSERVATIONS, help="of each of its frames")
    run = commands.add_parser("run", help="measure one asfm run")
    run.add_argument("sequence", type=Path)
    rates = commands.add_parser("rates", help="false-alarm rates over the asked ones, on noise and in empty water")
    rates.add_argument("data", type=Path, nargs="?", metavar="DATA_FOLDER")
    rates.add_argument("--images", type=int, default=8, help="512 x 512 images of noise; 8 give 2,000 alarms at 1e-3")
    reach = commands.add_parser("public", help="measure the public runs, in one table")
    reach.add_argument("data", type=Path, metavar="DATA_FOLDER")
    for command in (run, frontend, backend):
        command.add_argument("--set", dest="settings", action="append", default=[], metavar="SECTION.KEY=VALUE")
    for command in (run, reach):
        command.add_argument("--recording", action="store_true", help="with the viewer's recording, which takes longer")
    return parser


def _add_timing(command: argparse.ArgumentParser) -> None:
    command.add_argument("--rounds", type=int, default=9)
    command.add_argument("--clock", choices=CLOCKS, default="wall")
    command.add_argument("--threads", type=int, default=1, help="threads of OpenCV; the peers use one")


def _add_sequences(command: argparse.ArgumentParser) -> None:
    command.add_argument("data", type=Path, nargs="?", metavar="DATA_FOLDER")
    command.add_argument("--scenes", nargs="*", default=SEEN, metavar="SCENE")
    command.add_argument("--sonars", nargs="*", default=SONARS, metavar="PRESET")
    command.add_argument("--seeds", type=int, default=5, help="so many runs of each scene before each sonar")
    command.add_argument(
        "--narrow-seeds", type=int, help="runs of the narrow sonar that sways fast; as many by default"
    )
    command.add_argument("--frames", type=int, default=80)
    command.add_argument("--modes", nargs="+", choices=MODES, default=tuple(MODES))
    command.add_argument("--cache", type=Path, metavar="DIR", help="keeps the sequences; else a temporary folder")
    command.add_argument("--jobs", type=int, default=1, help="sequences measured at once")
    command.add_argument("--no-bound", dest="bound", action="store_false", help="spare the time that the bound takes")


def _report_backend(options: argparse.Namespace) -> int:
    cases = list_cases(options.scenes, options.sonars, options.seeds, options.frames)
    narrow_seeds = options.seeds if options.narrow_seeds is None else options.narrow_seeds
    tasks = list_tasks(cases, list_narrow_cases(narrow_seeds, options.frames), options.data, options.modes)
    runs = []
    try:
        load_config(None, tuple(options.settings))
        with tempfile.TemporaryDirectory() as scratch:
            cache = options.cache or Path(scratch)
            for task, run in measure_tasks(tasks, cache, tuple(options.settings), options.bound, options.jobs):
                print(describe_accuracy(run), flush=True)
                runs.append((task, run))
    except AsfmError as error:
        print(error, file=sys.stderr)
        return 1
    print()
    return _show_table(list(list_backend_numbers(runs)))


def _show_table(numbers: Sequence[Requirement]) -> int:
    print("\n".join(tabulate(numbers)))
    return 1 if any(number.ok is False for number in numbers) else 0


def _report_frontend(options: argparse.Namespace) -> int:
    try:
        config = load_config(None, tuple(options.settings))
        numbers = list(list_numbers(options.data, options.sequences, config, options.rounds, CLOCKS[options.clock]))
    except AsfmError as error:
        print(error, file=sys.stderr)
        return 1
    return _show_table(numbers)


def _report_run(options: argparse.Namespace) -> int:
    try:
        lines = describe_run(measure_run(options.sequence, options.settings, options.recording))
    except RunFailed as failure:
        print(failure, file=sys.stderr)
        return 1
    print("\n".join(lines))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
