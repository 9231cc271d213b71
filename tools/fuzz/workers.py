"""Fuzz workers: forked processes that read batches of damaged files, so that a crash or a hang in a library counts."""

import os
import select
import signal
from dataclasses import dataclass, field
from pathlib import Path

from tools.fuzz.cases import LOADED, REFUSED, Target, limit_memory, run_case

BATCH = 500
"""Cases of one worker."""
MEMORY_BYTES = 1 << 30
"""Address space that a worker may take above what it has at its start."""
SILENCE_S = 30.0
"""A worker that finishes no case for so long hangs where Python cannot stop it."""


@dataclass
class Count:
    """Outcomes of the cases of one target."""

    cases: int = 0
    refused: int = 0
    loaded: int = 0
    failures: list[str] = field(default_factory=list)
    """A line for each case that neither loads nor is refused in one line."""

    def add(self, case: int, outcome: str) -> None:
        """Count the outcome of a case."""
        self.cases += 1
        self.refused += outcome == REFUSED
        self.loaded += outcome == LOADED
        if outcome not in (REFUSED, LOADED):
            self.failures.append(f"case {case}: {outcome}")


def run_target(target: Target, folder: Path, cases: int, seed: int) -> Count:
    """Read so many damaged files in forked workers; case i is the same in every run with the same seed."""
    target.make(folder)
    content = (folder / target.file).read_bytes()
    valid = content if target.unpack is None else target.unpack(content)
    count, first = Count(), 0
    while first < cases:
        last = min(first + BATCH, cases)
        first = _run_batch(target, folder, valid, (seed, first, last), count)
    return count


def run_here(target: Target, folder: Path, cases: int, seed: int) -> Count:
    """Read so many damaged files in this process."""
    target.make(folder)
    content = (folder / target.file).read_bytes()
    valid = content if target.unpack is None else target.unpack(content)
    count = Count()
    for case in range(cases):
        count.add(case, run_case(target, folder, valid, (seed, case)))
    return count


def _run_batch(target: Target, folder: Path, valid: bytes, batch: tuple[int, int, int], count: Count) -> int:
    """Fork a worker for the cases from ``first`` up to ``last``, and return the case to go on with."""
    _, first, last = batch
    source, sink = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(source)
        _work(target, folder, valid, batch, sink)
    os.close(sink)
    done, hangs = first, False
    with os.fdopen(source, "rb") as file:
        while done < last:
            hangs = not select.select([file], [], [], SILENCE_S)[0]
            line = b"" if hangs else file.readline()
            if not line:
                break
            count.add(done, line.decode().rstrip("\n"))
            done += 1
    if hangs:
        os.kill(child, signal.SIGKILL)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if done < last:
        count.add(done, f"hangs for {SILENCE_S:g} s" if hangs else f"the process ends with {status}")
        done += 1
    return done


def _divert_output(path: Path) -> int:
    """Send what this process prints, libraries included, to a file, and return its descriptor."""
    printed = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND)
    for stream in (1, 2):
        os.dup2(printed, stream)
    return printed


def _take(printed: int) -> str:
    """Return what was printed since the last call."""
    size = os.fstat(printed).st_size
    if not size:
        return ""
    text = os.pread(printed, min(size, 1000), 0)
    os.ftruncate(printed, 0)
    return text.decode(errors="backslashreplace")


def _work(target: Target, folder: Path, valid: bytes, batch: tuple[int, int, int], sink: int) -> None:
    """Run the cases as the child, write a line for each, and exit."""
    seed, first, last = batch
    code = 1
    try:
        (folder / target.file).write_bytes(valid if target.pack is None else target.pack(valid))
        target.read(folder)  # loads libraries; a valid file that is refused ends the batch
        limit_memory(MEMORY_BYTES)
        printed = _divert_output(folder.parent / "printed")
        for case in range(first, last):
            outcome = run_case(target, folder, valid, (seed, case))
            text = _take(printed)
            outcome = f"a library prints {text[:160]!r}" if text and outcome in (REFUSED, LOADED) else outcome
            os.write(sink, outcome.replace("\n", " ").encode(errors="backslashreplace") + b"\n")
        code = 0
    finally:
        os._exit(code)
