"""Benchmarks of asfm: kernels against independent implementations, stages and whole runs against requirements.

``python -m tools.benchmark all``, or the name of one kernel, times a kernel and its peers in one process. They take
turns, so that a busy machine slows all of them alike; the results are the ratio of the medians and whether the outputs
agree.
``python -m tools.benchmark frontend [DATA_FOLDER]`` lists the requirements on the front-end beside what it reaches:
times of its stages, the time of a frame over that of A-KAZE alone, and the match quality on sequences with true poses.
``python -m tools.benchmark rates [DATA_FOLDER]`` measures the false-alarm rates of CFAR on noise and recorded water.
``python -m tools.benchmark backend [DATA_FOLDER]`` lists the requirements on the back-end beside what it reaches over
simulated sequences (and recordings with true poses, if their folder is given): pose errors, covariances, landmarks.
``python -m tools.benchmark backend-speed`` times the bundle adjustment against factors in Python, and a long sequence.
``python -m tools.benchmark mistakes`` makes plausible mistakes in two simulated sequences; none may go without a word.
``python -m tools.benchmark run SEQUENCE [--set SECTION.KEY=VALUE]...`` measures one ``asfm run`` in a child process.
``python -m tools.benchmark public DATA_FOLDER`` measures ``asfm run`` on the public recordings, in one table.
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
from asfm.simulation.simulate import simulate
from tools.benchmark.accuracy import MODES, describe_accuracy
from tools.benchmark.backend import list_backend_numbers, list_tasks, measure_tasks
from tools.benchmark.false_alarm_rates import list_rates
from tools.benchmark.frontend import SEQUENCES, list_frontend_numbers
from tools.benchmark.kernels import COMPARISONS, Comparison, choose_comparisons, time_in_turns
from tools.benchmark.long_sequence import BATCH_FRAMES, BATCH_OBSERVATIONS, list_batch_numbers
from tools.benchmark.mistake_runs import (
    MISTAKE_SCENES,
    SENSOR_MODES,
    compare_mistakes,
    hold_images,
    list_mistake_numbers,
    tabulate_cells,
)
from tools.benchmark.native_factors import compare_factors
from tools.benchmark.runs import RunFailed, describe_run, measure_run, tabulate_public
from tools.benchmark.simulated_cases import SCENE_NAMES, SONAR_NAMES, list_cases, list_narrow_cases
from tools.benchmark.table import Requirement, tabulate

CLOCKS: dict[str, Callable[[], float]] = {"wall": time.perf_counter, "processor": time.process_time}
"""On a shared machine, processor time is fairer: what takes longer is interrupted more often."""


def report(comparison: Comparison, rounds: int, clock: Callable[[], float] = time.perf_counter) -> bool:
    """Print the medians, their ratios and whether the results agree; return whether all do."""
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
    """Run the command line; return 1 where results disagree, a requirement is not met or a run fails."""
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
    if options.what == "mistakes":
        return _report_mistakes(options)
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
    """Return the parser, with a sub-command for each kernel and each of the other benchmarks."""
    parser = argparse.ArgumentParser(prog="python -m tools.benchmark", description=(__doc__ or "").splitlines()[0])
    commands = parser.add_subparsers(dest="what", required=True, metavar="WHAT")
    for name in (*COMPARISONS, "all"):
        command = commands.add_parser(name, help="every kernel" if name == "all" else f"compare the kernel {name}")
        command.add_argument(
            "--shape", type=int, nargs=2, default=(600, 256), metavar=("RANGES", "BEAMS"), help="of the image"
        )
        command.add_argument("--seed", type=int, default=0, help="of the image")
        _add_timing(command)
    frontend = commands.add_parser("frontend", help="requirements on the front-end beside what it reaches")
    frontend.add_argument("data", type=Path, nargs="?", metavar="DATA_FOLDER")
    frontend.add_argument("--sequences", nargs="+", default=SEQUENCES, metavar="NAME", help="folders below DATA_FOLDER")
    _add_timing(frontend)
    backend = commands.add_parser("backend", help="requirements on the back-end beside what it reaches")
    _add_sequences(backend)
    mistakes = commands.add_parser("mistakes", help="run plausible mistakes: none may be wrong without a word")
    mistakes.add_argument("--frames", type=int, default=60, help="of each of the two sequences")
    mistakes.add_argument("--scenes", nargs="+", default=MISTAKE_SCENES, metavar="SCENE", help="scenes to simulate")
    mistakes.add_argument("--modes", nargs="+", choices=SENSOR_MODES, default=tuple(SENSOR_MODES), metavar="MODE")
    speed = commands.add_parser(
        "backend-speed", help="time the bundle adjustment against factors in Python, and a long sequence"
    )
    speed.add_argument("--frames", type=int, default=BATCH_FRAMES, help="frames of the long sequence")
    speed.add_argument(
        "--observations", type=int, default=BATCH_OBSERVATIONS, help="observations in each of its frames"
    )
    run = commands.add_parser("run", help="measure one asfm run in a child process")
    run.add_argument("sequence", type=Path)
    rates = commands.add_parser("rates", help="measure false-alarm rates of CFAR on noise and in empty water")
    rates.add_argument("data", type=Path, nargs="?", metavar="DATA_FOLDER")
    rates.add_argument(
        "--images", type=int, default=8, help="number of 512 x 512 images of noise; 8 give 2,000 false alarms at 1e-3"
    )
    public = commands.add_parser("public", help="measure asfm run on the public recordings, in one table")
    public.add_argument("data", type=Path, metavar="DATA_FOLDER")
    for command in (run, frontend, backend):
        command.add_argument("--set", dest="settings", action="append", default=[], metavar="SECTION.KEY=VALUE")
    for command in (run, public):
        command.add_argument(
            "--recording", action="store_true", help="make the viewer's recording too, which takes longer"
        )
    return parser


def _add_timing(command: argparse.ArgumentParser) -> None:
    command.add_argument("--rounds", type=int, default=9, help="of which the median is taken")
    command.add_argument("--clock", choices=CLOCKS, default="wall", help="wall or processor time")
    command.add_argument("--threads", type=int, default=1, help="threads of OpenCV; the peers use one")


def _add_sequences(command: argparse.ArgumentParser) -> None:
    command.add_argument("data", type=Path, nargs="?", metavar="DATA_FOLDER")
    command.add_argument("--scenes", nargs="*", default=SCENE_NAMES, metavar="SCENE", help="scenes to simulate")
    command.add_argument("--sonars", nargs="*", default=SONAR_NAMES, metavar="PRESET", help="sonars to simulate")
    command.add_argument("--seeds", type=int, default=5, help="sequences of each scene and sonar")
    command.add_argument(
        "--narrow-seeds", type=int, help="sequences of the narrow sonar at each speed; as many by default"
    )
    command.add_argument("--frames", type=int, default=80, help="of each sequence")
    command.add_argument("--modes", nargs="+", choices=MODES, default=tuple(MODES), help="sensors that a run uses")
    command.add_argument(
        "--cache", type=Path, metavar="DIR", help="folder that keeps the sequences; temporary by default"
    )
    command.add_argument("--jobs", type=int, default=1, help="sequences measured at once")
    command.add_argument(
        "--no-bound", dest="bound", action="store_false", help="do not measure the accuracy bound, which takes long"
    )


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


def _report_mistakes(options: argparse.Namespace) -> int:
    cells = []
    for scene in options.scenes:
        found = []
        sequence = hold_images(simulate(scene, frame_count=options.frames).sequence)
        for cell in compare_mistakes(sequence, tuple(options.modes)):
            print("\n".join(tabulate_cells(scene, [cell])[2:]), file=sys.stderr, flush=True)
            found.append(cell)
        print("\n".join([*tabulate_cells(scene, found), ""]), flush=True)
        cells += found
    return _show_table(list_mistake_numbers(cells))


def _show_table(numbers: Sequence[Requirement]) -> int:
    print("\n".join(tabulate(numbers)))
    return 1 if any(number.ok is False for number in numbers) else 0


def _report_frontend(options: argparse.Namespace) -> int:
    try:
        config = load_config(None, tuple(options.settings))
        numbers = list(
            list_frontend_numbers(options.data, options.sequences, config, options.rounds, CLOCKS[options.clock])
        )
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
