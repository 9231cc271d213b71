"""Accumulation of echoes in the pixels, against plain loops over the echoes."""

import numpy as np
import pytest

from asfm.simulation.acoustics.accumulation import SAME_SURFACE_RAD, accumulate_power, average_elevation
from asfm.simulation.acoustics.echoes import Echoes
from asfm.simulation.acoustics.rays import RayFan
from asfm.types import FloatArray, IntArray

ROWS, BEAMS = 6, 3


def _echoes(row: FloatArray, beam: IntArray, power: FloatArray, elevation_rad: FloatArray) -> Echoes:
    count = len(row)
    fan = RayFan(
        np.zeros((3, count), np.float32),
        np.asarray(beam),
        np.asarray(elevation_rad, np.float32),
        np.ones(count, np.float32),
        0.01,
    )
    no_rays, no_offsets = np.zeros(0, np.int64), np.zeros(0, np.float32)
    return Echoes(np.asarray(row, np.float32), np.asarray(power, np.float32), fan, no_rays, no_offsets)


@pytest.mark.parametrize("seed", range(5))
def test_power_is_divided_between_the_two_nearest_rows(seed: int) -> None:
    rng = np.random.default_rng(seed)
    row, beam, power = rng.uniform(-2, ROWS + 2, 200), rng.integers(0, BEAMS, 200), rng.uniform(0.1, 1, 200)
    expected = np.zeros((BEAMS, ROWS))
    for at, column, value in zip(row, beam, power, strict=True):
        for pixel in range(ROWS):
            expected[column, pixel] += value * max(0.0, 1 - abs(at - (pixel + 0.5)))
    found = accumulate_power(_echoes(row, beam, power, np.zeros(200)), (BEAMS, ROWS))
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_elevation_is_the_weighted_mean_of_the_strongest_surface() -> None:
    """Two surfaces in one pixel: the mean is over the stronger one alone."""
    near_rad = 0.1 + SAME_SURFACE_RAD * np.array([0.0, 0.4])
    row, beam = np.full(3, 2.5), np.ones(3, dtype=int)
    found = average_elevation(_echoes(row, beam, np.array([2.0, 1.0, 1.9]), np.array([*near_rad, -0.1])), (ROWS, BEAMS))
    assert found.shape == (ROWS, BEAMS)
    assert found[2, 1] == pytest.approx((2 * near_rad[0] + near_rad[1]) / 3, abs=1e-6)
    assert np.isnan(np.delete(found.ravel(), 2 * BEAMS + 1)).all()
