"""report.json: diagnostics as objects, and errors of the reader."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asfm.config import Config
from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError
from asfm.geometry.sonar import SonarModel
from asfm.results.report_json import external_features, read_report, warning_codes, write_report
from asfm.results.run_summary import RunSummary
from asfm.sequence import Sequence
from asfm.stages import StageReport
from asfm.types import Frame, Landmarks, Reconstruction, Tracks, Trajectory

DIAGNOSTICS = (
    Diagnostic("odometry-gap", "no odometry near frames 1-2", ((1, 2),)),
    Diagnostic("estimated-range-bias", "a bias of 0.02 m", severity="info"),
)


def make_summary(folder: Path) -> RunSummary:
    none, few = np.zeros(0, int), np.zeros(0)
    landmarks = Landmarks(none, np.zeros((0, 3)), np.zeros((0, 3, 3)), few, none, none > 0, np.zeros((0, 15, 3)))
    trajectory = Trajectory(np.arange(4.0), np.tile(np.eye(4), (4, 1, 1)))
    tracks = Tracks(none, none, few, few)
    reconstruction = Reconstruction(trajectory, tracks, none > 0, landmarks, np.zeros((4, 6, 6)), DIAGNOSTICS)

    def read_frame(index: int) -> Frame:
        raise AssertionError("the report must not read frames")

    sonar = SonarModel.evenly_spaced("toy", (0.5, 8.0), (-0.6, 0.5), (15, 11), 0.2)
    sequence = Sequence("toy", sonar, trajectory.timestamps_s, read_frame)
    stages = (StageReport("front-end", 1.5, 100.0, {"frames": 4}),)
    return RunSummary(folder, folder / "sequence", sequence, reconstruction, stages, DIAGNOSTICS, None, 2.0)


def test_report_states_sequence_counts_stages_and_diagnostics(tmp_path: Path) -> None:
    write_report(tmp_path / "report.json", make_summary(tmp_path), Config(seed=5))
    report = read_report(tmp_path)
    path = str(tmp_path / "sequence")
    assert report["sequence"] == {"path": path, "name": "toy", "format": "native", "frames": 4}
    assert report["counts"] == {"poses": 4, "tracks": 0, "landmarks": 0, "well_constrained": 0}
    assert report["seed"] == 5
    stage = {"name": "front-end", "wall_s": 1.5, "peak_memory_mb": 100.0, "counts": {"frames": 4}}
    assert report["stages"] == [stage]
    assert report["warnings"] == [
        {
            "code": "odometry-gap",
            "message": "no odometry near frames 1-2",
            "frames": [[1, 2]],
            "severity": "warning",
        },
        {"code": "estimated-range-bias", "message": "a bias of 0.02 m", "frames": [], "severity": "info"},
    ]


def test_files_of_external_matches_are_named(tmp_path: Path) -> None:
    summary = make_summary(tmp_path)
    write_report(tmp_path / "report.json", summary, Config())
    assert external_features(read_report(tmp_path)) is None
    files = (tmp_path / "features.h5", tmp_path / "matches.h5")
    write_report(tmp_path / "report.json", replace(summary, external_matches=files), Config())
    assert external_features(read_report(tmp_path)) == files[0]
    assert [external_features({"external_matches": found}) for found in (3, [], [4], None)] == [None] * 4


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "found no report.json in it"),
        ("{", r"report\.json: cannot read a report"),
        ("[]", "no sequence in it"),
        (json.dumps({"sequence": {}}), "expected the sequence's path"),
    ],
)
def test_unusable_report_is_a_one_line_error(tmp_path: Path, content: str | None, message: str) -> None:
    if content is not None:
        (tmp_path / "report.json").write_text(content)
    with pytest.raises(AsfmError, match=message) as caught:
        read_report(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("report", "codes"),
    [
        ({"warnings": [found.as_dict() for found in DIAGNOSTICS]}, {"odometry-gap", "estimated-range-bias"}),
        ({"warnings": ["a sentence, as older versions wrote", {"message": "no code"}, {"code": 3}]}, set()),
        ({"warnings": "none"}, set()),
        ({}, set()),
    ],
)
def test_codes_are_those_of_the_diagnostics_that_have_one(report: dict[str, object], codes: set[str]) -> None:
    assert warning_codes(report) == codes
