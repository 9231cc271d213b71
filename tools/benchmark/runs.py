"""Runs of ``asfm run``, each in a process of its own: pose error, wall time, memory and warnings."""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asfm.commands.text import align
from asfm.evaluation.pose_error_table import ATE_OVER_PATH, ATE_RMSE

SONAR_ALONE = ("backend.use_odometry=false", "backend.use_navigation=false")

PUBLIC_RUNS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("oculus_tank_b", "oculus_tank_b", ()),
    ("oculus_tank_a", "oculus_tank_a", ()),
    ("simulated_seafloor", "simulated_seafloor", ()),
    ("simulated_seafloor, sonar alone", "simulated_seafloor", SONAR_ALONE),
    ("aris/sample.aris", "aris/sample.aris", ()),
    ("turtle_sim", "turtle_sim", ()),
    ("holoocean_boat", "holoocean_boat", ()),
)
"""The runs on public recordings, in order: title, path below the data folder, settings."""


@dataclass(frozen=True)
class RunMeasure:
    """Time, memory and pose error of one run."""

    frames: int
    wall_s: float
    """Of the whole process, with its imports."""
    peak_mb: float
    """Largest resident memory of the process."""
    stages: tuple[dict[str, Any], ...]
    """As report.json lists them."""
    warnings: tuple[str, ...]
    """The diagnostics in report.json: message and code."""
    ate_m: float | None
    """RMSE, SE(3)-aligned, scale off; None without true poses, as are the next three where they do not exist."""
    odometry_ate_m: float | None
    ratio: float | None
    """ATE / odometry's ATE."""
    path_percent: float | None
    """ATE in percent of the reference's path length."""


class RunFailed(Exception):
    """A run exited with another code than 0; the message is its error."""


def measure_run(sequence: Path, settings: Sequence[str] = (), recording: bool = False) -> RunMeasure:
    """Run ``asfm run`` in a child process, with its results in a temporary folder.

    Args:
        sequence: path of a sequence of any supported format.
        settings: each as section.key=value.
        recording: make the viewer's recording too, which is asfm's default.

    Raises:
        RunFailed: the child exited with an error.
    """
    with tempfile.TemporaryDirectory() as scratch:
        results = Path(scratch) / "results"
        command = [sys.executable, "-m", "asfm", "run", str(sequence), "--output", str(results)]
        command += [] if recording else ["--no-rerun"]
        command += [part for setting in settings for part in ("--set", setting)]
        begin_s = time.perf_counter()
        child = subprocess.run(command, capture_output=True, text=True, check=False)
        wall_s = time.perf_counter() - begin_s
        if child.returncode != 0:
            raise RunFailed(_explain_failure(child.returncode, child.stderr))
        report = json.loads((results / "report.json").read_text(encoding="utf-8"))
        evaluation = results / "evaluation.json"
        rows = json.loads(evaluation.read_text(encoding="utf-8"))["rows"] if evaluation.is_file() else []
    return summarise(report, rows, wall_s)


def _explain_failure(code: int, stderr: str) -> str:
    """Return the last line of asfm's error output; for a defect, the exception and the first lines of its message."""
    traceback = stderr.rpartition("Traceback (most recent call last):\n")[2] if code == 1 else ""
    exception = [line.strip() for line in traceback.splitlines() if line.strip() and not line.startswith(" ")]
    last = stderr.strip().splitlines()[-1:] or [f"ended with code {code}"]
    return " ".join(exception[:3] or last)


def summarise(report: dict[str, Any], rows: list[dict[str, Any]], wall_s: float) -> RunMeasure:
    """Collect the measures from report.json and the rows of evaluation.json."""
    by_key = {row["key"]: row for row in rows}
    error = by_key.get(ATE_RMSE, {})
    return RunMeasure(
        frames=report["sequence"]["frames"],
        wall_s=wall_s,
        peak_mb=max((stage["peak_memory_mb"] for stage in report["stages"]), default=0.0),
        stages=tuple(report["stages"]),
        warnings=tuple(f"{item['message']} [{item['code']}]" for item in report["warnings"]),
        ate_m=error.get("value"),
        odometry_ate_m=error.get("odometry"),
        ratio=error.get("ratio"),
        path_percent=by_key.get(ATE_OVER_PATH, {}).get("value"),
    )


def describe_run(run: RunMeasure) -> list[str]:
    """Return the lines that describe one run, with one line a stage."""
    lines = align(
        [
            ("frames", str(run.frames), ""),
            ("ATE, SE(3)-aligned, no scale", _show(run.ate_m, 4), "m"),
            ("the odometry's ATE", _show(run.odometry_ate_m, 4), "m"),
            ("ratio", _show(run.ratio, 3), ""),
            ("ATE / path", _show(run.path_percent, 2), "%"),
            ("wall", f"{run.wall_s:.1f}", "s"),
            ("peak", f"{run.peak_mb:.0f}", "MB"),
        ],
        numbers=(1,),
    )
    table = [("stage", "s", "peak MB", "made")]
    for stage in run.stages:
        made = ", ".join(f"{count:,g} {name}" for name, count in stage["counts"].items())
        table.append((stage["name"], f"{stage['wall_s']:.2f}", f"{stage['peak_memory_mb']:.0f}", made))
    return [*lines, "", *align(table, numbers=(1, 2)), *(f"warning: {warning}" for warning in run.warnings)]


def tabulate_public(data: Path, recording: bool = False) -> tuple[list[str], bool]:
    """Measure the public runs one after the other and return the table's lines, and whether all runs succeeded."""
    table = [("run", "frames", "ATE m", "ratio or path", "wall s", "peak MB", "warnings")]
    failures = []
    for title, path, settings in PUBLIC_RUNS:
        try:
            table.append((title, *_cells(measure_run(data / path, settings, recording))))
        except RunFailed as failure:
            table.append((title, "", "", "failed", "", "", ""))
            failures.append(f"{title}: {failure}")
    return align(table, numbers=range(1, 7)) + failures, not failures


def _cells(run: RunMeasure) -> tuple[str, str, str, str, str, str]:
    share = f"{_show(run.ratio, 3)} x" if run.ratio is not None else f"{_show(run.path_percent, 2)} %"
    quality = share if run.ate_m is not None else "-"
    sizes = (f"{run.wall_s:.1f}", f"{run.peak_mb:.0f}", str(len(run.warnings)))
    return (str(run.frames), _show(run.ate_m, 4), quality, *sizes)


def _show(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
