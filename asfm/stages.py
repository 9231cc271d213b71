"""Wall time, peak memory, counts and progress of each stage of a run."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

Progress = Callable[[str, int, int], None]
"""Called as progress(stage, done, total) while a stage is running."""


def no_progress(stage: str, done: int, total: int) -> None:
    """Ignore progress reports."""


@dataclass
class StageReport:
    """Cost and output counts of one stage."""

    name: str
    wall_s: float = 0.0
    peak_memory_mb: float = 0.0
    """Largest resident memory of the process until the end of the stage."""
    counts: dict[str, float] = field(default_factory=dict)
    """Number of items produced, by name: frames, keypoints, tracks ..."""


@dataclass
class StageClock:
    """Stopwatch of the stages of one run, in order."""

    progress: Progress = no_progress
    reports: list[StageReport] = field(default_factory=list)

    @contextmanager
    def stage(self, name: str) -> Iterator[StageReport]:
        """Measure time and memory of the body.

        Yields:
            The report of the stage; the body adds its counts.
        """
        report = StageReport(name)
        begin = time.perf_counter()
        yield report
        report.wall_s = time.perf_counter() - begin
        report.peak_memory_mb = peak_memory_mb()
        self.reports.append(report)


def peak_memory_mb() -> float:
    """Return the peak resident memory of this process in megabytes; 0 on systems that do not report it."""
    try:
        import resource
    except ImportError:
        return 0.0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e6 if sys.platform == "darwin" else 1e3)
