"""Noise of the DIDSON preset compared with recorded pings of empty water."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from asfm.simulation.acoustics.noise import add_noise
from asfm.simulation.sonars.parameters import make_sonar_model
from asfm.simulation.sonars.presets import PRESETS
from asfm.types import FloatArray

ZONES = [slice(0, 64), slice(64, 128), slice(128, 256), slice(256, 512)]


def _cumulative_distribution(counts: NDArray[np.uint8]) -> FloatArray:
    """Return the (256,) cumulative distribution of 8-bit values."""
    return np.asarray(np.cumsum(np.bincount(counts.ravel(), minlength=256)) / counts.size)


@pytest.fixture(scope="module")
def recorded(shared_data: Path) -> NDArray[np.uint8]:
    files = sorted((shared_data / "didson_hull" / "open_water").glob("*.png"))
    if not files:
        pytest.skip("the DIDSON pings of open water are not there")
    return np.stack([np.asarray(cv2.imread(str(file), cv2.IMREAD_UNCHANGED)) for file in files])


@pytest.fixture(scope="module")
def simulated() -> NDArray[np.uint8]:
    sonar = PRESETS["didson"]
    model = make_sonar_model(sonar)
    dark = np.zeros(model.shape, dtype=np.float32)
    pings = [add_noise(dark, sonar, model, np.random.default_rng(ping)) for ping in range(60)]
    return np.round(255 * np.stack(pings)).astype(np.uint8)


def test_simulated_and_recorded_pings_have_the_same_distribution(
    recorded: NDArray[np.uint8], simulated: NDArray[np.uint8]
) -> None:
    """Kolmogorov-Smirnov distance over all pixels, and in each interval of ranges."""
    assert recorded.shape[1:] == simulated.shape[1:]
    assert np.abs(_cumulative_distribution(recorded) - _cumulative_distribution(simulated)).max() < 0.02
    for zone in ZONES:
        assert (
            np.abs(_cumulative_distribution(recorded[:, zone]) - _cumulative_distribution(simulated[:, zone])).max()
            < 0.04
        )


def test_reverberation_decreases_with_range_and_off_the_axis(
    recorded: NDArray[np.uint8], simulated: NDArray[np.uint8]
) -> None:
    for pings in (recorded, simulated):
        dark = (pings == 0).mean(axis=0)
        assert dark[:48, 40:56].mean() < 0.40 < dark[400:, 40:56].mean()
        assert dark[:48, :8].mean() > 0.6


def test_uniform_rayleigh_noise_does_not_have_that_distribution(recorded: NDArray[np.uint8]) -> None:
    """The comparison is sensitive: Rayleigh noise of one scale with the same mean is far from the pings."""
    scale = recorded.mean() / np.sqrt(np.pi / 2)
    plain = np.round(np.random.default_rng(0).rayleigh(scale, recorded.shape[1:])).astype(np.uint8)
    assert np.abs(_cumulative_distribution(recorded) - _cumulative_distribution(plain)).max() > 0.2
