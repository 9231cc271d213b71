"""report.json: what a run read, made and took, and with which versions."""

import json
import platform
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from asfm.config import Config
from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError
from asfm.evaluation.pose_error_table import EvaluationTable
from asfm.sequence import Sequence
from asfm.stages import StageReport
from asfm.types import Reconstruction

DISTRIBUTIONS = ("asfm", "gtsam", "numpy", "opencv-python-headless", "scipy", "scikit-learn", "rerun-sdk")
"""Those whose version can change a result."""


@dataclass(frozen=True)
class RunSummary:
    """What a run made and what it took."""

    folder: Path
    """Where the results are."""
    source: Path
    """Where the sequence is."""
    sequence: Sequence
    reconstruction: Reconstruction
    stages: tuple[StageReport, ...]
    diagnostics: tuple[Diagnostic, ...]
    """The sequence's and the reconstruction's."""
    evaluation: EvaluationTable | None
    """None where the sequence knows nothing to compare with."""
    wall_s: float
    """From opening the sequence until its results were written, but for the report."""


def describe_run(summary: RunSummary, config: Config) -> dict[str, Any]:
    """Turn a summary into what report.json holds; the sequence's path is absolute."""
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
        "counts": {
            "poses": len(summary.reconstruction.trajectory.timestamps_s),
            "tracks": summary.reconstruction.tracks.count,
            "landmarks": len(landmarks),
            "well_constrained": int(landmarks.well_constrained.sum()),
        },
        "stages": [vars(stage) for stage in summary.stages],
        "wall_s": summary.wall_s,
        "warnings": [item.as_dict() for item in summary.diagnostics],
        "versions": {"python": platform.python_version()} | {name: _find_version(name) for name in DISTRIBUTIONS},
        "platform": platform.platform(),
    }


def read_report(folder: Path) -> dict[str, Any]:
    """Read the report of a folder of results.

    Raises:
        AsfmError: there is none, or it is not one that asfm wrote.
    """
    path = folder / "report.json"
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise AsfmError(f"{folder}: expected a folder that asfm run wrote, found no report.json in it") from None
    except OSError as error:
        raise AsfmError(f"{path}: cannot read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise AsfmError(f"{path}: expected JSON, found something else: {error}") from None
    if not isinstance(report, dict) or not isinstance(report.get("sequence"), dict):
        raise AsfmError(f"{path}: expected a report of asfm run, found no sequence in it")
    if not isinstance(report["sequence"].get("path"), str):
        raise AsfmError(f"{path}: expected the sequence's path in it, found none")
    return report


def _find_version(distribution: str) -> str | None:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return None
