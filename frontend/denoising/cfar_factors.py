"""CFAR threshold factors (CA, OS, GOCA, SOCA) for a given false-alarm probability in exponential noise.

Let the reference cells be independent and exponential with mean 1. A cell of the same noise exceeds factor * statistic
with probability E[exp(-factor * statistic)]. Each function solves for the factor that makes this the given probability.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, betaln

from asfm.types import FloatArray, IntArray

MAX_TABLE_ENTRIES = 1 << 22
"""Entries of the largest table of GOCA and SOCA factors that is kept in memory."""
LOG_TOLERANCE = 1e-8
"""Relative error of the probability at which the root search stops."""


def ca_factors(count: IntArray, probability: float) -> FloatArray:
    """Return the CA-CFAR factors n (P^(-1/n) - 1) for (N,) numbers of cells n: (N,), infinite for n = 0."""
    factors = np.full(len(count), np.inf)
    some = count[count > 0]
    factors[count > 0] = some * np.expm1(-np.log(probability) / some)
    return factors


def order_ranks(count: IntArray, order_fraction: float) -> IntArray:
    """Return the OS-CFAR ranks ceil(order_fraction * n), 1 = smallest, for (N,) numbers of cells n: (N,)."""
    return np.asarray(np.clip(np.ceil(order_fraction * count - 1e-9).astype(np.int64), 1, np.maximum(count, 1)))


def os_factors(count: IntArray, probability: float, order_fraction: float) -> FloatArray:
    """Solve for the OS-CFAR factors of the k-th smallest of n cells, k from :func:`order_ranks`.

    The false-alarm probability is the product over i = 0..k-1 of (n - i) / (n - i + factor) (Rohling 1983), a ratio of
    two beta functions. Setting all terms to the last or to the first one gives the two brackets of the root.

    Args:
        count: (N,) numbers of reference cells n.
        probability: false-alarm probability.
        order_fraction: k / n, before rounding up.

    Returns:
        (N,) factors, infinite for n = 0.
    """
    factors = np.full(len(count), np.inf)
    some = count[count > 0].astype(float)
    rank = order_ranks(count, order_fraction)[count > 0]
    above = some - rank + 1
    constant = betaln(above, rank)
    factors[count > 0] = _solve(
        lambda factor: betaln(above + factor, rank) - constant,
        np.log(probability),
        above * np.expm1(-np.log(probability) / rank),
        some * np.expm1(-np.log(probability) / rank),
    )
    return factors


def goca_soca_factors(count_a: IntArray, count_b: IntArray, probability: float, greatest: bool) -> FloatArray:
    """Solve for the GOCA or SOCA factors of the means of a leading and a lagging window.

    Where one window is empty the factor is that of CA for the other one. The CA factors of the single windows bracket
    the root: for GOCA with the probabilities sqrt(P) and P, for SOCA with P and P / 2.

    Args:
        count_a: (N,) numbers of cells in the one window.
        count_b: (N,) numbers of cells in the other window.
        probability: false-alarm probability.
        greatest: true for GOCA, false for SOCA.

    Returns:
        (N,) factors, infinite where both windows are empty.
    """
    factors = ca_factors(np.maximum(count_a, count_b), probability)
    both = (count_a > 0) & (count_b > 0)
    a, b = count_a[both], count_b[both]
    if greatest:
        low, high = (np.minimum(ca_factors(a, p), ca_factors(b, p)) for p in (probability**0.5, probability))
    else:
        low, high = (np.maximum(ca_factors(a, p), ca_factors(b, p)) for p in (probability, probability / 2))
    factors[both] = _solve(
        lambda factor: np.log(goca_soca_probability(factor, a, b, greatest)), np.log(probability), low, high
    )
    return factors


def lookup_goca_soca_factors(
    count_a: NDArray[np.integer], count_b: NDArray[np.integer], max_count: int, probability: float, greatest: bool
) -> FloatArray:
    """Look up :func:`goca_soca_factors` of (ranges, beams) counts up to ``max_count``; each pair is solved once."""
    side = max_count + 1
    pair = np.multiply(count_a, side, dtype=np.intp) + count_b
    if side * side > MAX_TABLE_ENTRIES:
        pairs, position = np.unique(pair, return_inverse=True)
        return goca_soca_factors(pairs // side, pairs % side, probability, greatest).take(position.reshape(pair.shape))
    table = _factor_table(side, probability, greatest)
    factors = table.take(pair)
    if np.isnan(factors).any():
        missing = np.zeros(side * side, dtype=bool)
        missing[pair[np.isnan(factors)]] = True
        pairs = np.flatnonzero(missing)
        table[pairs] = goca_soca_factors(pairs // side, pairs % side, probability, greatest)
        factors = table.take(pair)
    return np.asarray(factors)


@lru_cache(maxsize=4)
def _factor_table(side: int, _probability: float, _greatest: bool) -> FloatArray:
    """Return the cache of factors, (side * side,) by pair of counts: NaN until a pair is first needed."""
    return np.full(side * side, np.nan)


def goca_soca_probability(factor: FloatArray, count_a: IntArray, count_b: IntArray, greatest: bool) -> FloatArray:
    """Compute the (N,) false-alarm probabilities of (N,) GOCA or SOCA factors; no count may be zero.

    The probability is E[exp(-factor * mean_a); a is selected] plus the same for b. A gamma density times an exponential
    is another gamma density, so the first term is (1 + factor/a)^-a, the probability of a alone, times the probability
    that a is selected under the tilted density: an incomplete beta function.
    """
    total = count_a + count_b + factor
    probability = np.zeros(len(total))
    for own, other in ((count_a, count_b), (count_b, count_a)):
        selected = betainc(other, own, other / total) if greatest else betainc(own, other, (own + factor) / total)
        probability += np.exp(-own * np.log1p(factor / own)) * selected
    return probability


def _solve(
    log_probability: Callable[[FloatArray], FloatArray], target: float, low: FloatArray, high: FloatArray
) -> FloatArray:
    """Solve log_probability(factor) = target for N decreasing functions by the Illinois method in log(factor).

    The roots lie between the (N,) brackets low and high. Returns (N,) factors.
    """
    # A root may coincide with its bracket, and rounding must not put it outside.
    low, high = np.log(low) - 1e-6, np.log(high) + 1e-6
    at_low, at_high = (log_probability(np.exp(end)) - target for end in (low, high))
    middle, was_below = low, None
    for _ in range(100):
        middle = high - at_high * (high - low) / (at_high - at_low)
        at_middle = log_probability(np.exp(middle)) - target
        if np.all(np.abs(at_middle) < LOG_TOLERANCE):
            break
        below = at_middle > 0
        # Illinois: halve the value at an end that is kept twice in a row, or convergence is one-sided and slow.
        kept = np.zeros(len(low), dtype=bool) if was_below is None else below == was_below
        at_low, at_high = (
            np.where(kept & ~below, 0.5 * at_low, at_low),
            np.where(kept & below, 0.5 * at_high, at_high),
        )
        low, at_low = np.where(below, middle, low), np.where(below, at_middle, at_low)
        high, at_high = np.where(below, high, middle), np.where(below, at_high, at_middle)
        was_below = below
    return np.exp(middle)
