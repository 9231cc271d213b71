"""A small study with every kind of cell, run once for the tests of studies."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
STUDY = """
name: every kind of cell
simulate: {scenes: [tank], sonars: [didson], frames: 4}
seeds: 2
modes: [all]
detectors: [akaze]
filters:
  ratio: [mutual, ratio]
  every: [mutual, ratio, arc, planar, ssl]
external:
  - {name: corners, function: "study_matchers:match_corners"}
  - {name: broken, function: "study_matchers:fail"}
corruption: {wrong_share: [0, 0.3], points: 60}
bound_draws: 1
"""
MATCHERS = '''
"""External matchers of a test: strongest pixels of coarse blocks, matched by block."""

import numpy as np


def find_peaks(image):
    rows, columns = image.shape[0] // 16, image.shape[1] // 16
    blocks = image[: rows * 16, : columns * 16].reshape(rows, 16, columns, 16).swapaxes(1, 2).reshape(-1, 256)
    place = blocks.argmax(axis=1)
    y = np.repeat(np.arange(rows), columns) * 16 + place // 16
    x = np.tile(np.arange(columns), rows) * 16 + place % 16
    return np.stack([x, y], axis=1), blocks.max(axis=1) > 0.3


def match_corners(image_a, image_b):
    (xy_a, strong_a), (xy_b, strong_b) = find_peaks(image_a), find_peaks(image_b)
    both = np.flatnonzero(strong_a & strong_b)
    return xy_a, xy_b, np.stack([both, both], axis=1)


def fail(image_a, image_b):
    raise ArithmeticError("no features today")
'''


def run_asfm(folder: Path, *arguments: str, start: bool = False) -> "subprocess.Popen[str]":
    """Start asfm in a process of its own, in a folder whose modules it can import; wait for it unless ``start``."""
    path = os.pathsep.join([str(ROOT), str(folder)])
    process = subprocess.Popen(
        [sys.executable, "-m", "asfm", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    if not start:
        out, err = process.communicate(timeout=300)
        assert process.returncode == 0, out + err
    return process


@pytest.fixture(scope="session")
def study_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with study.yaml, the module of its external matchers, and the finished study in results/."""
    folder = tmp_path_factory.mktemp("study")
    (folder / "study.yaml").write_text(STUDY)
    (folder / "study_matchers.py").write_text(MATCHERS)
    run_asfm(folder, "study", "study.yaml", "--output", "results", "--jobs", "2")
    return folder
