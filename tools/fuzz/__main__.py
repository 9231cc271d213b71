"""Fuzzing of every reader: each damaged file loads or is refused in one line, within a time and a memory bound.

python -m tools.fuzz [--target NAME] [--cases N] [--seed S]
"""

import argparse
import resource
import signal
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np

from asfm.errors import AsfmError
from tools.fuzz.mutation import mutate
from tools.fuzz.targets import TARGETS, Target

SECONDS, MEMORY_BYTES, MAX_MESSAGE = 5, 4 << 30, 700


def run_target(target: Target, folder: Path, cases: int, seed: int) -> list[str]:
    """Read so many damaged files, and return a line for each that neither loads nor is refused in one line."""
    target.make(folder)
    path = folder / target.file
    valid = path.read_bytes()
    target.read(folder)
    failures = []
    for case in range(cases):
        path.write_bytes(mutate(valid, np.random.default_rng([seed, case])))
        fault = _try(target, folder)
        if fault is not None:
            failures.append(f"case {case}: {fault}")
    return failures


def _try(target: Target, folder: Path) -> str | None:
    signal.alarm(SECONDS)
    try:
        target.read(folder)
    except AsfmError as error:
        message = str(error)
        return None if message.isprintable() and len(message) < MAX_MESSAGE else f"a long message: {message[:200]}"
    except (Exception, TimeoutError) as error:
        return f"{type(error).__name__}: {str(error)[:200]}"
    finally:
        signal.alarm(0)
    return None


def _stop(*_: object) -> None:
    raise TimeoutError(f"longer than {SECONDS} s")


def main() -> int:
    """Fuzz the targets, and return the number of failures, 1 at most."""
    parser = argparse.ArgumentParser(prog="python -m tools.fuzz", description=__doc__)
    parser.add_argument("--target", choices=sorted(TARGETS), action="append")
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    signal.signal(signal.SIGALRM, _stop)
    warnings.simplefilter("error", RuntimeWarning)
    failed = False
    for name in options.target or TARGETS:
        with tempfile.TemporaryDirectory() as folder:
            failures = run_target(TARGETS[name], Path(folder) / "seed", options.cases, options.seed)
        failed |= bool(failures)
        print(f"{name}: {len(failures)} of {options.cases} cases fail", *failures[:5], sep="\n  ", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
