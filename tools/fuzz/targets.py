"""Fuzz targets: a valid file of each kind, made by the project's own writers, and the reader that opens it."""

import json
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asfm.config import Config
from asfm.config_file import dump_config, load_config
from asfm.datasets import open_sequence, open_truth
from asfm.datasets.native.writer import write_native
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.simulation.scenes.mesh_file import read_mesh
from asfm.simulation.sonars.holoocean_scenario import read_mounted_sonar
from asfm.types import Frame, FrameTruth, Navigation, Trajectory

SCENARIO = {
    "agents": [
        {
            "sensors": [
                {
                    "sensor_type": "ImagingSonar",
                    "Hz": 2,
                    "location": [0, 0, 0],
                    "configuration": {"Azimuth": 60, "Elevation": 12, "RangeMin": 0.5, "RangeMax": 3, "RangeBins": 12},
                }
            ]
        }
    ]
}
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 2 3 4\nf 1 3 4\n"


@dataclass(frozen=True)
class Target:
    """A file to mutate within a folder, and the function that reads it."""

    file: str
    make: Callable[[Path], None]
    """Writes the valid folder."""
    read: Callable[[Path], object]
    """Reads the folder; raises AsfmError where it refuses."""


def _make_native(folder: Path) -> None:
    sonar = SonarModel.evenly_spaced("seed", (0.5, 3.0), (-0.5, 0.5), (12, 8), 0.2)
    rng = np.random.default_rng(0)
    images = (rng.integers(0, 256, (3, *sonar.shape)) / np.float32(255)).astype(np.float32)
    stamps_s = np.arange(3.0)
    sequence = Sequence(
        "seed",
        sonar,
        stamps_s,
        lambda index: Frame(index, float(index), images[index], images[index] > 1 - 0.1 * index),
        odometry=Trajectory(stamps_s, np.tile(np.eye(4), (3, 1, 1))),
        groundtruth=Trajectory(stamps_s, np.tile(np.eye(4), (3, 1, 1))),
        navigation=Navigation(stamps_s, np.zeros(3), np.zeros(3), np.zeros(3)),
    )
    truth = FrameTruth(np.zeros(sonar.shape), np.zeros(sonar.shape, dtype=np.float32))
    write_native(folder, sequence, truth=lambda _: truth, overwrite=True)


def _read_native(folder: Path) -> object:
    sequence, truth = open_sequence(folder), open_truth(folder)
    sequence.check_frames()
    return list(sequence), None if truth is None else truth(0)


def _make_pickles(folder: Path) -> None:
    (folder / "Data").mkdir(parents=True, exist_ok=True)
    (folder / "Config.json").write_text(json.dumps(SCENARIO), encoding="utf-8")
    for index in range(2):
        state = {"ImagingSonar": np.full((12, 8), 0.5, np.float32), "PoseSensor": np.eye(4), "t": float(index)}
        (folder / "Data" / f"{index}.pkl").write_bytes(pickle.dumps(state, protocol=4))


def _write(name: str, text: str) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")

    return make


NATIVE_FILES = ("sequence.yaml", "frames.csv", "odometry.tum", "groundtruth.tum", "navigation.csv")
TARGETS = {
    **{name: Target(name, _make_native, _read_native) for name in (*NATIVE_FILES, "frames/000000.png")},
    "truth.npz": Target("truth/000000.npz", _make_native, _read_native),
    "Config.json": Target("Config.json", _make_pickles, lambda folder: list(open_sequence(folder))),
    "tick.pkl": Target("Data/1.pkl", _make_pickles, lambda folder: list(open_sequence(folder))),
    "config": Target("c.yaml", _write("c.yaml", dump_config(Config())), lambda folder: load_config(folder / "c.yaml")),
    "scenario": Target(
        "s.json", _write("s.json", json.dumps(SCENARIO)), lambda folder: read_mounted_sonar(folder / "s.json")
    ),
    "mesh.obj": Target(
        "m.obj", _write("m.obj", OBJ), lambda folder: read_mesh(folder / "m.obj", np.random.default_rng(0))
    ),
}
