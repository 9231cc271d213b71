"""``asfm demo``: reproducible byte by byte, and replaces an earlier demo."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

Ask = Callable[..., str]

FRAMES = 6


def test_demo_is_reproducible_byte_by_byte(demo_folder: Path, tmp_path: Path, ask: Ask) -> None:
    text = ask("demo", "--frames", str(FRAMES), "--output", tmp_path / "again")
    results = tmp_path / "again" / "results"
    assert f"asfm view {results}\n" in text and "ATE RMSE, SE(3)-aligned, scale off: " in text
    for name in ("trajectory.tum", "points.ply", "pose_sigmas.csv", "tracks.csv", "config.yaml", "evaluation.json"):
        assert (results / name).read_bytes() == (demo_folder / "results" / name).read_bytes(), name
    ask("demo", "--frames", "2", "--output", tmp_path / "again")
    assert len(np.loadtxt(results / "trajectory.tum")) == 2, "an earlier demo is replaced"
