"""Fuzzing of every reader: each damaged file loads or is refused in one line, within a time and a memory bound.

python -m tools.fuzz [--target NAME] [--cases N] [--seed S]
"""

import argparse
import sys
import tempfile
from pathlib import Path

from tools.fuzz.targets import TARGETS
from tools.fuzz.workers import run_target


def main() -> int:
    """Fuzz the targets, and return 1 where a case fails, else 0."""
    parser = argparse.ArgumentParser(prog="python -m tools.fuzz", description=__doc__)
    parser.add_argument("--target", choices=sorted(TARGETS), action="append")
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    failed = False
    print(f"{'target':24}{'cases':>8}{'refused':>9}{'loaded':>8}{'failures':>10}", flush=True)
    for name in options.target or TARGETS:
        with tempfile.TemporaryDirectory() as folder:
            count = run_target(TARGETS[name], Path(folder) / "seed", options.cases, options.seed)
        failed |= bool(count.failures)
        numbers = f"{count.cases:8}{count.refused:9}{count.loaded:8}{len(count.failures):10}"
        print(f"{name:24}{numbers}", *(f"  {line}" for line in count.failures[:9]), sep="\n", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
