"""Residual consistency: chi-square of stretches by plain loops; noise as stated is consistent, biases are not."""

import numpy as np
import pytest

from asfm.backend.diagnostics.linearised_residuals import ResidualBlock
from asfm.backend.diagnostics.residual_consistency import (
    CHANNELS,
    MAX_MEAN_SQUARE,
    MAX_SUM,
    STRETCH_FRAMES,
    measure_residuals,
)
from asfm.types import FloatArray

FRAMES = 60


def make_block(
    residual: FloatArray, sensor: str = "depth and attitude", weight: FloatArray | None = None
) -> ResidualBlock:
    frame = np.arange(len(residual))
    weight = np.ones_like(residual) if weight is None else weight
    return ResidualBlock(sensor, frame, residual, weight, (), np.zeros((*residual.shape, 1)))


def noise(seed: int = 0, channels: int = 3) -> FloatArray:
    return np.random.default_rng(seed).standard_normal((FRAMES, channels))


def test_statistics_are_those_of_plain_loops() -> None:
    residual = noise()
    weight = np.ones_like(residual)
    weight[5:9, 1] = 0
    found = measure_residuals((make_block(residual, weight=weight),), FRAMES)
    assert [item.sensor for item in found] == ["depth", "attitude"]
    for item, columns in zip(found, ([0], [1, 2]), strict=True):
        stretches = range(FRAMES - STRETCH_FRAMES + 1)
        worst, largest_sum, where = 0.0, 0.0, 0
        for begin in stretches:
            for column in columns:
                kept = weight[begin : begin + STRETCH_FRAMES, column] > 0
                values = residual[begin : begin + STRETCH_FRAMES, column][kept]
                if np.mean(values**2) > worst:
                    worst, where = float(np.mean(values**2)), begin
                largest_sum = max(largest_sum, abs(values.sum()) / np.sqrt(len(values)))
        assert (item.worst_mean_square, item.worst_sum) == pytest.approx((worst, largest_sum))
        assert item.worst_frames == (where, where + STRETCH_FRAMES - 1)
        kept = weight[:, columns] > 0
        assert item.mean_square == pytest.approx(np.mean(residual[:, columns][kept] ** 2))


@pytest.mark.parametrize("seed", range(20))
def test_noise_as_stated_is_consistent(seed: int) -> None:
    found = measure_residuals((make_block(0.8 * noise(seed)),), FRAMES)
    assert not any(item.inconsistent for item in found)


def test_noise_beyond_what_is_stated_is_named_with_its_frames() -> None:
    residual = 0.5 * noise()
    residual[30:40, 0] *= 8
    depth, attitude = measure_residuals((make_block(residual),), FRAMES)
    assert not attitude.inconsistent and depth.worst_mean_square > MAX_MEAN_SQUARE
    ((first, last),) = depth.inconsistent
    assert 30 - STRETCH_FRAMES < first <= 30 and 39 <= last < 40 + STRETCH_FRAMES


def test_small_residuals_of_one_sign_are_inconsistent() -> None:
    """Each is within two standard deviations: only their run tells."""
    residual = np.zeros((FRAMES, 6))
    residual[10:30, 3] = 1.02 * MAX_SUM / np.sqrt(STRETCH_FRAMES)
    rotation, translation = measure_residuals((make_block(residual, "odometry"),), FRAMES)
    assert not rotation.inconsistent and translation.inconsistent == ((10, 29),)
    assert translation.worst_mean_square < MAX_MEAN_SQUARE and np.abs(residual).max() < 2


def test_short_sequences_are_one_stretch() -> None:
    depth, _ = measure_residuals((make_block(np.full((4, 3), 3.0)),), 4)
    assert depth.worst_frames == (0, 3) and depth.inconsistent == ((0, 3),)
    assert depth.worst_mean_square == pytest.approx(9.0)


def test_every_sensor_has_channels() -> None:
    assert set(CHANNELS) == {"sonar", "odometry", "depth and attitude"}
