"""The clock of a run: what each stage took and made, and how far it is."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

Progress = Callable[[str, int, int], None]
"""Called as progress(stage, done, total) while a stage works."""


def no_progress(stage: str, done: int, total: int) -> None:
    """Show nothing."""


@dataclass
class StageReport:
    """What one stage took and made."""

    name: str
    wall_s: float = 0.0
    peak_memory_mb: float = 0.0
    """Largest resident memory of the process up to the end of the stage."""
    counts: dict[str, float] = field(default_factory=dict)
    """What it made, by name: frames, keypoints, tracks ..."""


@dataclass
class StageClock:
    """Times the stages of one run, in order."""

    progress: Progress = no_progress
    reports: list[StageReport] = field(default_factory=list)

    @contextmanager
    def stage(self, name: str) -> Iterator[StageReport]:
        """Time the body; it fills in the counts of the report it is given."""
        report = StageReport(name)
        begin = time.perf_counter()
        yield report
        report.wall_s = time.perf_counter() - begin
        report.peak_memory_mb = peak_memory_mb()
        self.reports.append(report)


def peak_memory_mb() -> float:
    """Give the largest resident memory that this process has had, in megabytes; 0 where the system cannot tell."""
    try:
        import resource
    except ImportError:
        return 0.0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e6 if sys.platform == "darwin" else 1e3)
