"""Sonar presets: within the data sheets, uneven beams, noise statistics, reproducible bytes."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest
from scipy import stats

from asfm.datasets.aris.lenses import beam_centres_rad
from asfm.simulation.acoustics.correlated_fields import make_field_bank
from asfm.simulation.acoustics.noise import add_noise
from asfm.simulation.acoustics.receiver import make_point_spread
from asfm.simulation.simulate import simulate
from asfm.simulation.sonars.parameters import make_sonar_model
from asfm.simulation.sonars.presets import PRESETS
from asfm.types import ImageArray

SHEETS = {
    # horizontal aperture, vertical aperture, deg; beams; smallest and largest range in m; largest rate in Hz
    "oculus_m750d_high": (70, 12, 256, 0.1, 40, 40),
    "oculus_m750d_low": (130, 20, 256, 0.1, 120, 40),
    "oculus_m1200d_high": (60, 12, 512, 0.1, 10, 40),
    "oculus_m1200d_low": (130, 20, 512, 0.1, 40, 40),
    "didson": (29, 14, 96, 0.4, 40, 21),
    "aris_3000": (30, 14, 128, 0.7, 15, 15),
    "blueview_p900": (130, 20, 768, 0.5, 100, 25),
    "holoocean": (120, 20, 512, 0.1, 10, 200),
}


@pytest.mark.parametrize("name", PRESETS)
def test_preset_is_within_the_data_sheet(name: str) -> None:
    azimuth, elevation, beams, nearest_m, farthest_m, fastest_hz = SHEETS[name]
    sonar = PRESETS[name]
    assert (sonar.azimuth, sonar.elevation, sonar.azimuth_bins) == (azimuth, elevation, beams)
    assert nearest_m <= sonar.range_min < sonar.range_max <= farthest_m and sonar.rate_hz <= fastest_hz
    edges_deg = np.rad2deg(make_sonar_model(sonar).bearing_edges_rad[[0, -1]])
    assert np.ptp(edges_deg) == pytest.approx(azimuth, abs=1.3)  # bearings_deg are centres
    assert edges_deg.sum() == pytest.approx(0, abs=0.4)


def test_beams_of_lenses_and_line_arrays_are_uneven() -> None:
    aris = np.deg2rad(np.array(PRESETS["aris_3000"].bearings_deg))
    assert aris == pytest.approx(beam_centres_rad(128, telephoto=False), abs=1e-5)
    oculus = np.sin(np.deg2rad(np.array(PRESETS["oculus_m750d_low"].bearings_deg)))
    assert np.diff(oculus) == pytest.approx(np.diff(oculus).mean(), rel=0.01)
    didson = np.diff(np.array(PRESETS["didson"].bearings_deg))
    assert 0.20 < didson.min() < 0.24 and 0.35 < didson[44:52].mean() < 0.38  # widest in the middle
    assert np.ptp(np.array(PRESETS["didson"].bearings_deg)) == pytest.approx(28.5, abs=0.2)


def _draw(name: str, level: float, **changes: float) -> ImageArray:
    """Add the noise of a sonar with the changes to a clean image of one value."""
    flat = {"near_sigma": 0.0, "threshold": 0.0, "noise_range_exponent": 0.0}
    sonar = PRESETS[name].model_copy(update=flat | changes)
    model = make_sonar_model(sonar)
    lobe = make_point_spread(sonar, model).lobe
    bank = None if sonar.independent_beams else make_field_bank(lobe, np.random.default_rng(0))
    return add_noise(np.full(model.shape, level, dtype=np.float32), sonar, model, np.random.default_rng(5), bank)


@pytest.mark.parametrize("name", PRESETS)
def test_noise_of_every_sonar_has_the_requested_statistics(name: str) -> None:
    apart = _draw(name, 0.0, add_sigma=0.03)[:, ::16]  # beams whose lobes do not overlap
    assert stats.kstest(apart.ravel(), stats.rayleigh(scale=0.03).cdf).pvalue > 0.01
    assert stats.kstest(apart.ravel(), stats.rayleigh(scale=0.031).cdf).pvalue < 0.01
    for contrast in (0.15, 0.5):
        speckled = _draw(name, 0.08, add_sigma=0.0, mult_sigma=contrast)
        assert speckled.std() / speckled.mean() == pytest.approx(contrast, rel=0.05)


HASH_ON_ONE_CORE = """
import hashlib, os
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, [min(os.sched_getaffinity(0))])
from asfm.simulation.simulate import simulate
for name in ("didson", "oculus_m750d_high"):
    simulated = simulate("tank", name, 3, seed=8)
    truth = simulated.read_truth(2)
    for part in (simulated.sequence.read_frame(2).image, truth.clean, truth.elevation_rad):
        print(hashlib.sha256(part.tobytes()).hexdigest())
"""


def test_same_bytes_in_another_process_on_one_core() -> None:
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", HASH_ON_ONE_CORE]
    found = subprocess.run(command, env=os.environ | threads, capture_output=True, text=True, check=True).stdout.split()
    expected = []
    for name in ("didson", "oculus_m750d_high"):
        simulated = simulate("tank", name, 3, seed=8)
        truth = simulated.read_truth(2)
        for part in (simulated.sequence.read_frame(2).image, truth.clean, truth.elevation_rad):
            expected.append(hashlib.sha256(part.tobytes()).hexdigest())
    assert found == expected
