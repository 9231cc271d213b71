"""Fuzz targets of recordings: pickles of HoloOcean, ARIS and Oculus files."""

import json
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np

from asfm.datasets import open_sequence
from asfm.simulation.sonars.holoocean_scenario import read_mounted_sonar
from tests.datasets.aris_files import pack_header, write_file
from tests.datasets.oculus_files import BEAMS, RANGES, pack_message, pack_ping
from tools.fuzz.cases import Target

SONAR = {"Azimuth": 60, "Elevation": 12, "RangeMin": 0.5, "RangeMax": 3, "RangeBins": 12}
SENSOR = {"sensor_type": "ImagingSonar", "Hz": 2, "location": [0, 0, 0], "rotation": [0, 5, 0], "configuration": SONAR}
SCENARIO = {"ticks_per_sec": 200, "agents": [{"sensors": [SENSOR]}]}
ARIS_SAMPLES, ARIS_BEAMS = 20, 128


def read_sequence(path: Path) -> object:
    """Open a recording and read its frames, as ``asfm convert`` does."""
    sequence = open_sequence(path)
    sequence.check_frames()
    return list(sequence)


def write(name: str, content: str | bytes) -> Callable[[Path], None]:
    """Return a function that writes one file into a folder."""

    def make(folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)

    return make


def _make_pickles(folder: Path) -> None:
    (folder / "Data").mkdir(parents=True, exist_ok=True)
    (folder / "Config.json").write_text(json.dumps(SCENARIO), encoding="utf-8")
    for index in range(2):
        state = {"ImagingSonar": np.full((12, 8), 0.5, np.float32), "PoseSensor": np.eye(4), "t": float(index)}
        (folder / "Data" / f"{index}.pkl").write_bytes(pickle.dumps(state, protocol=4))


def _make_aris(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    pixels = np.random.default_rng(0).integers(0, 256, (2, ARIS_SAMPLES * ARIS_BEAMS), dtype=np.uint8)
    frames = [pack_header(10**6 * index, samples=ARIS_SAMPLES) + pixels[index].tobytes() for index in range(2)]
    write_file(folder / "x.aris", frames)


def _pack_oculus(version: int) -> bytes:
    images = np.random.default_rng(0).integers(0, 256, (3, RANGES, BEAMS))
    gains = np.full(RANGES, 4)
    pings = [pack_ping(image, version, gains=gains, start=index) for index, image in enumerate(images)]
    return pack_message(b"status", number=0x80) + b"".join(pings)


RECORDING_TARGETS = {
    "Config.json": Target("Config.json", _make_pickles, read_sequence),
    "tick.pkl": Target("Data/1.pkl", _make_pickles, read_sequence),
    "aris": Target("x.aris", _make_aris, lambda folder: read_sequence(folder / "x.aris")),
    **{
        f"oculus {version}": Target(
            "x.raw", write("x.raw", _pack_oculus(version)), lambda folder: read_sequence(folder / "x.raw")
        )
        for version in (1, 2)
    },
    "scenario": Target(
        "s.json", write("s.json", json.dumps(SCENARIO)), lambda folder: read_mounted_sonar(folder / "s.json")
    ),
}
