"""Track noise: recovered from simulated residuals, shrunk for short tracks, and inflated by autocorrelation."""

from itertools import pairwise

import numpy as np
import pytest

from asfm.backend.estimation.track_noise import (
    MAX_AUTOCORRELATION,
    MAX_LAG,
    MAX_NOISE_RATIO,
    MIN_NOISE_RATIO,
    MIN_TRACK_LENGTH,
    PRIOR_DEGREES_OF_FREEDOM,
    autocorrelation_inflation,
    estimate_track_noise,
)
from asfm.types import BoolArray, FloatArray, IntArray


def test_noise_ratios_of_tracks_are_recovered() -> None:
    rng = np.random.default_rng(0)
    true = np.repeat([1.0, 0.6, 2.0], [60, 20, 20])
    track = np.repeat(np.arange(100), 40)
    residual = rng.normal(size=(len(track), 2)) * true[track][:, None]
    found = estimate_track_noise(track, np.ones(len(track), dtype=bool), 0.3 * residual)  # the common scale cancels
    for value, margin in ((1.0, 0.05), (0.6, 0.07), (2.0, 0.15)):
        assert np.median(found[true == value]) == pytest.approx(value, abs=margin)


def test_short_tracks_stay_near_the_median() -> None:
    rng = np.random.default_rng(1)
    track = np.repeat(np.arange(300), 3)
    found = estimate_track_noise(track, np.ones(len(track), dtype=bool), rng.normal(size=(len(track), 2)))
    assert found.std() < 0.2 and abs(np.median(found) - 1) < 0.2


def test_unused_observations_have_no_influence_and_ratios_are_bounded() -> None:
    track = np.repeat(np.arange(12), 20)
    residual = np.ones((len(track), 2))
    residual[track == 0], residual[track == 1] = 1e3, 1e-9
    residual[5] = 1e6
    observed = np.ones(len(track), dtype=bool)
    observed[5] = False
    observed[track == 2] = False
    found = estimate_track_noise(track, observed, residual)
    assert found[0] == MAX_NOISE_RATIO and found[1] == MIN_NOISE_RATIO and found[2] == 1.0
    np.testing.assert_allclose(found[3:], 1.0, atol=0.05)


def test_zero_residuals_or_no_observations_give_ratio_one() -> None:
    track = np.repeat(np.arange(4), 5)
    nothing = np.zeros(0, dtype=np.int64)
    np.testing.assert_array_equal(estimate_track_noise(track, np.ones(20, dtype=bool), np.zeros((20, 2))), np.ones(4))
    assert estimate_track_noise(nothing, nothing.astype(bool), np.zeros((0, 2))).shape == (0,)


def make_autocorrelated(rho: float, tracks: int, length: int, rng: np.random.Generator) -> np.ndarray:
    """Simulate AR(1) errors of unit variance with correlation rho: (tracks, length, 2)."""
    errors = rng.normal(size=(tracks, length, 2))
    for step in range(1, length):
        errors[:, step] = rho * errors[:, step - 1] + np.sqrt(1 - rho**2) * errors[:, step]
    return errors


def test_long_run_variance_separates_autocorrelated_from_independent_errors() -> None:
    errors = make_autocorrelated(0.0, 200, 40, np.random.default_rng(2))
    errors[:40] = make_autocorrelated(0.8, 40, 40, np.random.default_rng(3))
    track = np.repeat(np.arange(200), 40)
    plain, found = (
        estimate_track_noise(track, np.ones(len(track), dtype=bool), errors.reshape(-1, 2), lags)
        for lags in (0, MAX_LAG)
    )
    np.testing.assert_allclose(np.median(plain[:40]), 1.0, atol=0.1)
    assert np.median(found[:40]) > 1.4 and np.median(found[40:]) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.6])
def test_inflation_is_the_root_of_the_long_run_variance_over_the_variance(rho: float) -> None:
    errors = make_autocorrelated(rho, 3000, 30, np.random.default_rng(4))
    track = np.repeat(np.arange(3000), 30)
    left = errors - errors.mean(axis=1, keepdims=True)  # as a fitted point leaves them
    found = autocorrelation_inflation(track, np.ones(len(track), dtype=bool), left.reshape(-1, 2))
    true = np.sqrt(30 * errors.mean(axis=1).var(axis=0))
    np.testing.assert_allclose(found, true, rtol=0.12)


def test_inflation_uses_observed_errors_of_long_tracks_only() -> None:
    errors = make_autocorrelated(0.9, 50, 20, np.random.default_rng(5)).reshape(-1, 2)
    track, observed = np.repeat(np.arange(50), 20), np.zeros(1000, dtype=bool)
    np.testing.assert_array_equal(autocorrelation_inflation(track, observed, errors), [1, 1])
    observed.reshape(50, 20)[:, :4] = True
    np.testing.assert_array_equal(autocorrelation_inflation(track, observed, errors), [1, 1])
    observed[:] = True
    assert (autocorrelation_inflation(track, observed, errors) > 2).all()
    np.testing.assert_array_equal(autocorrelation_inflation(track, observed, np.zeros((1000, 2))), [1, 1])
    assert (autocorrelation_inflation(track, observed, np.tile([1.0, -1.0], (1000, 1))) < 5).all(), (
        "bounded correlation"
    )


def draw_tracks(seed: int) -> tuple[IntArray, BoolArray, FloatArray]:
    """Draw residuals of tracks of 1 to 20 views whose errors alternate, persist or scatter."""
    rng = np.random.default_rng(seed)
    lengths = rng.integers(1, 21, 40)
    track = np.repeat(np.arange(40), lengths)
    rising = np.concatenate([np.arange(length) for length in lengths])
    kind = np.array([-0.9, 0.0, 0.9])[track % 3]
    mean = rng.normal(size=(40, 2))[track] * np.abs(kind)[:, None]
    residual = 0.5 * rng.normal(size=(len(track), 2)) + mean * np.where(kind < 0, (-1.0) ** rising, 1.0)[:, None]
    return track, rng.random(len(track)) < 0.9, residual


@pytest.mark.parametrize("lags", [0, 1, 3])
def test_noise_is_that_of_a_plain_sum_over_each_track(lags: int) -> None:
    """Posterior of a scaled inverse chi-square prior, on Bartlett-weighted sums taken one track at a time."""
    track, observed, residual = draw_tracks(lags)
    sums, freedoms = np.zeros(40), np.zeros(40)
    for number in range(40):
        own = residual[observed & (track == number)]
        sums[number] = np.sum(own**2)
        for lag in range(1, lags + 1):
            sums[number] += 2 * (1 - lag / (lags + 1)) * sum(float(a @ b) for a, b in zip(own, own[lag:], strict=False))
        freedoms[number] = max(2 * len(own) - 3, 0)
    sums, known, prior = np.maximum(sums, 0), freedoms > 0, PRIOR_DEGREES_OF_FREEDOM
    typical = np.median(sums[known] / freedoms[known])
    variance = (prior * typical + sums) / ((prior + freedoms) * typical)
    expected = np.where(known, np.clip(np.sqrt(variance), MIN_NOISE_RATIO, MAX_NOISE_RATIO), 1.0)
    found = estimate_track_noise(track, observed, residual, lags)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_autocorrelation_is_that_of_neighbours_within_long_tracks() -> None:
    track, observed, residual = draw_tracks(5)
    residual = 0.3 * residual + np.cumsum(residual, axis=0) * 0.02
    pairs, squares, lengths = [], [], []
    for number in range(40):
        own = residual[observed & (track == number)]
        if len(own) >= MIN_TRACK_LENGTH:
            pairs += [a * b for a, b in pairwise(own)]
            squares += list(own**2)
            lengths += [len(own)] * len(own)
    rho = np.mean(pairs, axis=0) / np.mean(squares, axis=0) + 1 / np.mean(lengths)
    rho = np.clip(rho, 0, MAX_AUTOCORRELATION)
    assert (rho > 0.1).all()
    found = autocorrelation_inflation(track, observed, residual)
    np.testing.assert_allclose(found, np.sqrt((1 + rho) / (1 - rho)), rtol=1e-9)
