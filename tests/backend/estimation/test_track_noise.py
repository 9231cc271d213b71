"""Track noise: recovered from simulated residuals, shrunk for short tracks, and inflated by autocorrelation."""

import numpy as np
import pytest

from asfm.backend.estimation.track_noise import (
    MAX_LAG,
    MAX_NOISE_RATIO,
    MIN_NOISE_RATIO,
    autocorrelation_inflation,
    estimate_track_noise,
)


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
