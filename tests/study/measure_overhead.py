"""Overhead of a study's engine: cells of one second that do nothing, against their ideal time.

``python -m tests.study.measure_overhead [CELLS [JOBS]]`` prints the time of each part and the load of the machine.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

from asfm.study.fork_server import start_fork_server


def measure(cells: int, jobs: int) -> None:
    """Run a grid of cells that each take one second."""
    begin_s = time.perf_counter()
    start_fork_server()  # as the command line does
    from asfm.study.study_run import RunSettings, compute_cells, load_grid
    from tests.study.engine_runs import wait_a_second

    imports_s = time.perf_counter() - begin_s
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "study.yaml"
        path.write_text(
            f"simulate: {{scenes: [tank], sonars: [didson], frames: 4}}\nseeds: {cells}\ndetectors: [akaze]\n"
        )
        begin_s = time.perf_counter()
        study, grid = load_grid(path)
        results = compute_cells(study, grid, Path(name) / "results", RunSettings(jobs), run=wait_a_second)
        total_s = time.perf_counter() - begin_s
    assert len(results.rows) == results.computed == cells
    ideal_s = cells / jobs
    over_percent = 100 * (total_s / ideal_s - 1)
    print(f"{cells} cells of 1 s on {jobs} processes: {total_s:.2f} s, {over_percent:.1f} % over the ideal")
    print(f"libraries before that: {imports_s:.2f} s; this process computed {time.process_time():.1f} s in all")
    print("load of the machine: " + " ".join(f"{load:.1f}" for load in os.getloadavg()))


if __name__ == "__main__":
    numbers = [int(argument) for argument in sys.argv[1:]]
    measure(*(numbers + [100, 2][len(numbers) :]))
