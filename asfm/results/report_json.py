"""report.json: input, counts, diagnostics, wall time and memory of each stage, and versions of a run."""

import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from asfm.config import Config
from asfm.errors import AsfmError, quote
from asfm.regular_file import is_present
from asfm.results.json_file import write_json
from asfm.results.results_folder import REPORT
from asfm.results.run_summary import RunSummary
from asfm.safe_json import read_json

MAX_PATH = 4096
DISTRIBUTIONS = ("asfm", "gtsam", "numpy", "opencv-python-headless", "scipy", "scikit-learn", "rerun-sdk")
"""The packages whose version can change a result."""


def write_report(path: Path, summary: RunSummary, config: Config) -> None:
    """Write the report of a run.

    Raises:
        AsfmError: the file cannot be written.
    """
    write_json(path, build_report(summary, config))


def build_report(summary: RunSummary, config: Config) -> dict[str, Any]:
    """Return the content of report.json; the path of the sequence is absolute."""
    landmarks = summary.reconstruction.landmarks
    return {
        "sequence": {
            "path": summary.source.resolve(),
            "name": summary.sequence.name,
            "format": summary.sequence.kind,
            "frames": len(summary.sequence),
        },
        "seed": config.seed,
        "mode": config.mode,
        "external_matches": [path.resolve() for path in summary.external_matches or ()],
        "counts": {
            "poses": len(summary.reconstruction.trajectory.timestamps_s),
            "tracks": summary.reconstruction.tracks.count,
            "landmarks": len(landmarks),
            "well_constrained": int(landmarks.well_constrained.sum()),
        },
        "noise": summary.noise.model_dump(mode="json"),
        "consistency": summary.reconstruction.consistency.as_dict(),
        "stages": [vars(stage) for stage in summary.stages],
        "wall_s": summary.wall_s,
        "warnings": [item.as_dict() for item in summary.diagnostics],
        "versions": {"python": platform.python_version()} | {name: find_version(name) for name in DISTRIBUTIONS},
        "platform": platform.platform(),
    }


def read_report(folder: Path) -> dict[str, Any]:
    """Read the report of a results folder; it names at least the path of the sequence.

    Raises:
        AsfmError: there is no report, or it was not written by asfm run.
    """
    path = folder / REPORT
    if not is_present(path):
        raise AsfmError(f"{folder}: expected a folder that asfm run wrote, found no {REPORT} in it")
    report = read_json(path, "a report of asfm run")
    if not isinstance(report, dict) or not isinstance(report.get("sequence"), dict):
        raise AsfmError(f"{path}: expected a report of asfm run, found no sequence in it")
    if not isinstance(report["sequence"].get("path"), str):
        raise AsfmError(f"{path}: expected the sequence's path in it, found none")
    if "\0" in report["sequence"]["path"] or len(report["sequence"]["path"]) > MAX_PATH:
        raise AsfmError(f"{path}: expected the sequence's path in it, found {quote(report['sequence']['path'])}")
    return report


def external_features(report: dict[str, Any]) -> Path | None:
    """Return the file of the keypoints that a run took from another detector; None where it detected its own."""
    files = report.get("external_matches")
    return Path(files[0]) if isinstance(files, list) and files and isinstance(files[0], str) else None


def warning_codes(report: dict[str, Any]) -> frozenset[str]:
    """Return the codes of the diagnostics in a report; none of those that older versions wrote without a code."""
    warnings = report.get("warnings")
    listed = warnings if isinstance(warnings, list) else []
    return frozenset(item["code"] for item in listed if isinstance(item, dict) and isinstance(item.get("code"), str))


def find_version(distribution: str) -> str | None:
    """Return the version of an installed distribution; None where it is not installed."""
    try:
        return version(distribution)
    except PackageNotFoundError:
        return None
