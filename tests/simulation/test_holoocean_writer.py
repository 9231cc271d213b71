"""Writer of HoloOcean's layout: what it writes is read back."""

import json
from pathlib import Path

import numpy as np
import pytest

from asfm.datasets import open_sequence
from asfm.errors import AsfmError
from asfm.simulation.holoocean_writer import describe_scenario, write_pickles
from asfm.simulation.simulate import simulate
from asfm.simulation.sonars.holoocean_scenario import read_mounted_sonar
from asfm.simulation.sonars.parameters import ImagingSonar
from asfm.simulation.sonars.presets import PRESETS


def test_description_reads_back(tmp_path: Path) -> None:
    sonar = ImagingSonar(
        range_bins=64, azimuth_bins=32, range_max=6, add_sigma=0.1, multi_path=True, noise_range_exponent=2
    )
    path = tmp_path / "b.json"
    path.write_text(json.dumps(describe_scenario(sonar, "pier")), encoding="utf-8")
    again = read_mounted_sonar(path).sonar
    same = {"name", "rate_hz", "independent_beams"}
    assert again.model_dump(exclude=same) == sonar.model_dump(exclude=same)


def test_written_pickles_are_read_back(tmp_path: Path) -> None:
    simulated = simulate("tank", "holoocean", frame_count=3)
    steps: list[tuple[int, int]] = []
    write_pickles(tmp_path / "out", simulated, progress=lambda done, total: steps.append((done, total)))
    assert steps == [(1, 3), (2, 3), (3, 3)]
    again = open_sequence(tmp_path / "out")
    assert again.kind == "holoocean" and len(again) == 3
    assert np.array_equal(again.read_frame(1).image, simulated.sequence.read_frame(1).image)
    assert again.groundtruth is not None and simulated.sequence.groundtruth is not None
    assert again.groundtruth.world_from_vehicle == pytest.approx(simulated.sequence.groundtruth.world_from_vehicle)
    assert again.sonar.bearing_rad == pytest.approx(simulated.sequence.sonar.bearing_rad)
    assert again.sonar.range_m == pytest.approx(simulated.sequence.sonar.range_m)
    with pytest.raises(AsfmError, match="out"):
        write_pickles(tmp_path / "out", simulated)
    write_pickles(tmp_path / "out", simulated, overwrite=True)


def test_uneven_beams_are_refused(tmp_path: Path) -> None:
    simulated = simulate("tank", "didson", frame_count=1)
    with pytest.raises(AsfmError, match="uneven beams"):
        write_pickles(tmp_path / "out", simulated)
    assert list(tmp_path.iterdir()) == []
    assert PRESETS["didson"].bearings_deg is not None
