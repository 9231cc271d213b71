"""Estimate of a study's time: what is shared counts once, and more of anything takes longer."""

from pathlib import Path
from typing import Any

from asfm.study.grid import build_grid
from asfm.study.study_definition import StudyDefinition
from asfm.study.time_estimate import Estimate, estimate_time

BASE: dict[str, Any] = {
    "simulate": {"scenes": ["tank"], "sonars": ["didson"], "frames": 10},
    "detectors": ["akaze"],
    "filters": {"a": [], "b": ["mutual"]},
}


def estimate(folder: Path, **keys: Any) -> Estimate:
    return estimate_time(build_grid(StudyDefinition.model_validate({**BASE, **keys}), folder))


def test_shared_work_counts_once(tmp_path: Path) -> None:
    base = estimate(tmp_path)
    assert (base.cells, base.sequences, base.features) == (2, 1, 1)
    more = estimate(tmp_path, modes=["sonar", "all"], seeds=3, detectors=["akaze", "orb"])
    assert (more.cells, more.sequences, more.features) == (24, 3, 6)
    assert base.hours < more.hours < 12 * base.hours * 2


def test_more_of_anything_takes_longer(tmp_path: Path) -> None:
    base = estimate(tmp_path).hours
    changes: tuple[dict[str, Any], ...] = (
        {"bound_draws": 9},
        {"modes": ["sonar"]},
        {"corruption": {}},
        {"filters": {"a": [], "b": [], "c": []}},
    )
    for keys in changes:
        changed = estimate(tmp_path, **keys).hours
        assert changed > base, keys
