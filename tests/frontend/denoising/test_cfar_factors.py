"""CFAR threshold factors against the false-alarm probability, integrated numerically or multiplied out."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import gamma

from asfm.frontend.denoising.cfar_factors import (
    ca_factors,
    goca_soca_factors,
    lookup_goca_soca_factors,
    order_ranks,
    os_factors,
)

PROBABILITIES = [0.9, 1e-1, 1e-3, 1e-6]


@pytest.mark.parametrize("probability", PROBABILITIES)
def test_ca_factors_give_the_probability(probability: float) -> None:
    counts = np.array([1, 2, 17, 744])
    factors = ca_factors(counts, probability)
    np.testing.assert_allclose((1 + factors / counts) ** -counts.astype(float), probability, rtol=1e-9)


@pytest.mark.parametrize("greatest", [True, False])
@pytest.mark.parametrize("probability", PROBABILITIES)
def test_goca_and_soca_factors_give_the_probability(probability: float, greatest: bool) -> None:
    a, b = np.array([[1, 1], [1, 9], [3, 4], [12, 12], [364, 364], [364, 5]]).T
    for n, m, factor in zip(a, b, goca_soca_factors(a, b, probability, greatest), strict=True):
        assert integrate_probability(float(factor), n, m, greatest) == pytest.approx(probability, rel=1e-5)


def integrate_probability(factor: float, count_a: int, count_b: int, greatest: bool) -> float:
    """Integrate exp(-factor * mean) over the density of the selected mean, of the one window or of the other."""
    a, b = gamma(count_a, scale=1 / count_a), gamma(count_b, scale=1 / count_b)

    def integrand(mean: float) -> float:
        rejected = [d.cdf(mean) if greatest else d.sf(mean) for d in (a, b)]
        return float(np.exp(-factor * mean) * (a.pdf(mean) * rejected[1] + b.pdf(mean) * rejected[0]))

    knots = np.unique(np.concatenate([d.ppf([1e-9, 1e-3, 0.5, 0.999, 1 - 1e-9]) for d in (a, b)]))
    pieces = zip([0.0, *knots], [*knots, 60.0], strict=True)
    return float(sum(quad(integrand, low, high, epsrel=1e-8)[0] for low, high in pieces))


def test_with_an_empty_window_the_factor_is_that_of_the_other() -> None:
    none, some = np.array([0, 0, 5]), np.array([0, 7, 0])
    for greatest in (True, False):
        expected = ca_factors(np.array([0, 7, 5]), 1e-2)
        np.testing.assert_array_equal(goca_soca_factors(none, some, 1e-2, greatest), expected)
    assert np.isinf(goca_soca_factors(none, some, 1e-2, True)[0])


@pytest.mark.parametrize("max_count", [40, 5000])
def test_looked_up_factors_equal_solved_ones_whatever_is_cached(max_count: int) -> None:
    rng = np.random.default_rng(0)
    for _ in range(3):
        a, b = rng.integers(0, 40, (2, 12, 13), dtype=np.int32)
        expected = goca_soca_factors(a.ravel(), b.ravel(), 1e-3, False).reshape(a.shape)
        np.testing.assert_allclose(lookup_goca_soca_factors(a, b, max_count, 1e-3, False), expected, rtol=1e-8)


@pytest.mark.parametrize("order_fraction", [0.01, 0.5, 0.75, 1.0])
@pytest.mark.parametrize("probability", PROBABILITIES)
def test_os_factors_give_the_probability(probability: float, order_fraction: float) -> None:
    counts = np.array([1, 2, 7, 24, 744])
    factors, ranks = os_factors(counts, probability, order_fraction), order_ranks(counts, order_fraction)
    for n, k, factor in zip(counts, ranks, factors, strict=True):
        product = np.prod([(n - i) / (n - i + factor) for i in range(k)])
        assert product == pytest.approx(probability, rel=1e-7)
    assert np.isinf(os_factors(np.array([0]), probability, order_fraction)).all()


def test_ranks_round_up_and_stay_in_range() -> None:
    np.testing.assert_array_equal(order_ranks(np.array([0, 1, 4, 5, 100]), 0.75), [1, 1, 3, 4, 75])
    np.testing.assert_array_equal(order_ranks(np.array([10, 100]), 0.07), [1, 7])
    np.testing.assert_array_equal(order_ranks(np.array([1, 10]), 1.0), [1, 10])
