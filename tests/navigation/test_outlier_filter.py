"""Outlier filter: planted outliers are found wherever they are, smooth series have none, and gaps are respected."""

import numpy as np
import pytest
from scipy.ndimage import median_filter

from asfm.navigation.outlier_filter import HALF_WINDOW, find_outliers, running_median


@pytest.mark.parametrize("count", [0, 1, 2, 3, 7, 8, 30])
def test_straight_line_has_no_outlier(count: int) -> None:
    line = np.outer(np.arange(count), [0.3, -2.0])
    assert not find_outliers(line, 1e-6)[0].any()


@pytest.mark.parametrize("index", [0, 1, 5, 18, 19])
def test_outlier_on_a_slope_is_found_at_every_position(index: int) -> None:
    values = np.arange(20.0)[:, None] * 0.5 + np.random.default_rng(0).normal(0, 0.01, (20, 1))
    values[index] += 3.0
    outlier, deviation = find_outliers(values, 0.01)
    assert np.flatnonzero(outlier[:, 0]).tolist() == [index]
    assert deviation[index, 0] == pytest.approx(3.0, abs=0.1)


@pytest.mark.parametrize("seed", range(5))
def test_gaussian_noise_is_not_rejected_and_channels_are_independent(seed: int) -> None:
    values = np.random.default_rng(seed).normal(0, 0.01, (200, 2))
    values[50, 1] = 1.0
    outlier, _ = find_outliers(values, 0.01)
    assert np.argwhere(outlier).tolist() == [[50, 1]]


def test_adding_a_parabola_changes_nothing() -> None:
    values = np.random.default_rng(3).normal(0, 0.01, (40, 1))
    values[[7, 20, 21]] += 0.5
    time_s = np.arange(40.0)
    parabola = (0.02 * time_s**2 - 0.7 * time_s)[:, None]
    outlier, deviation = find_outliers(values, 0.01)
    again, deviation_again = find_outliers(values + parabola, 0.01)
    assert np.flatnonzero(outlier).tolist() == [7, 20, 21]
    np.testing.assert_array_equal(again, outlier)
    np.testing.assert_allclose(deviation_again[outlier], deviation[outlier], rtol=0.02)


@pytest.mark.parametrize("period", [10, 16, 20, 40])
@pytest.mark.parametrize("phase_rad", np.arange(0.0, 6.0, 0.5))
def test_rolling_vehicle_has_no_outliers_even_at_the_ends(period: int, phase_rad: float) -> None:
    roll_deg = 10 * np.sin(2 * np.pi * np.arange(60) / period + phase_rad)
    roll_deg += np.random.default_rng(period).normal(0, 0.2, 60)
    assert not find_outliers(roll_deg[:, None], 0.2)[0].any()


@pytest.mark.parametrize("index", [0, 1, 20, 58, 59])
def test_outlier_of_a_rolling_vehicle_is_found(index: int) -> None:
    roll_deg = 10 * np.sin(2 * np.pi * np.arange(60) / 30) + np.random.default_rng(0).normal(0, 0.2, 60)
    roll_deg[index] += 30
    assert np.flatnonzero(find_outliers(roll_deg[:, None], 0.2)[0]).tolist() == [index]


def test_level_change_across_a_gap_is_no_outlier_and_too_few_neighbours_are_not_tested() -> None:
    values = np.concatenate([np.zeros(12), [5.0, 5.0], np.zeros(12)])[:, None]
    values += np.random.default_rng(4).normal(0, 0.01, values.shape)
    even = np.arange(26.0)
    apart = even + 1000 * (even >= 12) + 1000 * (even >= 14)
    assert np.flatnonzero(find_outliers(values, 0.01, even)[0]).tolist() == [12, 13]
    outlier, deviation = find_outliers(values, 0.01, apart)
    assert not outlier.any() and not deviation[12:14].any()


def test_running_median_agrees_with_scipy_inside_and_holds_the_last_full_window_at_the_ends() -> None:
    values = np.random.default_rng(5).normal(size=(30, 3))
    found = running_median(values)
    expected = median_filter(values, size=(2 * HALF_WINDOW + 1, 1))
    inner = slice(HALF_WINDOW, -HALF_WINDOW)
    np.testing.assert_array_equal(found[inner], expected[inner])
    np.testing.assert_array_equal(found[:HALF_WINDOW], np.repeat(found[HALF_WINDOW][None], HALF_WINDOW, axis=0))
    np.testing.assert_array_equal(running_median(values[:2]), values[:2])
