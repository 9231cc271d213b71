"""Threshold factors that give a detector the asked false-alarm probability in exponential noise.

Let the reference cells be independent, exponential, of mean 1. A cell of the same noise exceeds factor * statistic with
the probability E[exp(-factor * statistic)]. Each function below solves for the factor that makes this the asked one.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, betaln

from asfm.types import FloatArray, IntArray

LARGEST_TABLE = 1 << 22
"""Entries of the largest table of factors of two halves that is kept."""
LOG_TOLERANCE = 1e-8
"""Relative error of the probability at which a factor is good enough."""


def ca_factors(count: IntArray, probability: float) -> FloatArray:
    """Factors of the mean of (N,) counts of cells, n (P^(-1/n) - 1); infinite for no cells. (N,)."""
    factors = np.full(len(count), np.inf)
    some = count[count > 0]
    factors[count > 0] = some * np.expm1(-np.log(probability) / some)
    return factors


def order_ranks(count: IntArray, order_fraction: float) -> IntArray:
    """Rank (1 = smallest) of the cell that stands for (N,) counts of cells: the fraction of them, rounded up. (N,)."""
    return np.asarray(np.clip(np.ceil(order_fraction * count - 1e-9).astype(np.int64), 1, np.maximum(count, 1)))


def os_factors(count: IntArray, probability: float, order_fraction: float) -> FloatArray:
    """Factors of the k-th smallest of (N,) counts of cells, k from :func:`order_ranks`; infinite for no cells. (N,).

    The probability is the product over i = 0..k-1 of (n - i) / (n - i + factor), a ratio of two beta functions. Were
    all terms like the last or like the first, the root would be one of the two brackets.
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
    """Factors of the greater (or the smaller) of the means of two halves with (N,) cells each. (N,).

    Where a half has no cells the other one stands alone; where both have none the factor is infinite. The halves' own
    factors bracket the root: the greater mean needs no larger a factor than either half, and no smaller a one than the
    sum of both; the smaller mean no smaller a one than either, and no larger a one than P shared out between them.
    """
    factors = ca_factors(np.maximum(count_a, count_b), probability)
    both = (count_a > 0) & (count_b > 0)
    a, b = count_a[both], count_b[both]
    if greatest:
        low, high = (np.minimum(ca_factors(a, p), ca_factors(b, p)) for p in (probability**0.5, probability))
    else:
        low, high = (np.maximum(ca_factors(a, p), ca_factors(b, p)) for p in (probability, probability / 2))
    factors[both] = _solve(
        lambda factor: np.log(halves_probability(factor, a, b, greatest)), np.log(probability), low, high
    )
    return factors


def lookup_goca_soca_factors(
    count_a: NDArray[np.integer], count_b: NDArray[np.integer], largest: int, probability: float, greatest: bool
) -> FloatArray:
    """Find :func:`goca_soca_factors` for (R, B) counts up to ``largest``, solving each pair of counts once. (R, B)."""
    side = largest + 1
    pair = np.multiply(count_a, side, dtype=np.intp) + count_b
    if side * side > LARGEST_TABLE:
        pairs, position = np.unique(pair, return_inverse=True)
        return goca_soca_factors(pairs // side, pairs % side, probability, greatest).take(position.reshape(pair.shape))
    table = _table(side, probability, greatest)
    factors = table.take(pair)
    if np.isnan(factors).any():
        wanted = np.zeros(side * side, dtype=bool)
        wanted[pair[np.isnan(factors)]] = True
        pairs = np.flatnonzero(wanted)
        table[pairs] = goca_soca_factors(pairs // side, pairs % side, probability, greatest)
        factors = table.take(pair)
    return np.asarray(factors)


@lru_cache(maxsize=4)
def _table(side: int, probability: float, greatest: bool) -> FloatArray:
    """Make the table that fills as pairs of counts are met; not a number where none has been."""
    return np.full(side * side, np.nan)


def halves_probability(factor: FloatArray, count_a: IntArray, count_b: IntArray, greatest: bool) -> FloatArray:
    """False-alarm probability of (N,) factors of the greater (or the smaller) mean of two halves with cells. (N,).

    It is the sum of E[exp(-factor * mean_a); a wins] and the same for b. A gamma density times an exponential is
    another gamma density, so the first is (1 + factor/a)^-a, as if a were alone, times the chance that it still wins
    after this tilt: an incomplete beta function.
    """
    total = count_a + count_b + factor
    probability = np.zeros(len(total))
    for own, other in ((count_a, count_b), (count_b, count_a)):
        wins = betainc(other, own, other / total) if greatest else betainc(own, other, (own + factor) / total)
        probability += np.exp(-own * np.log1p(factor / own)) * wins
    return probability


def _solve(
    log_probability: Callable[[FloatArray], FloatArray], wanted: float, low: FloatArray, high: FloatArray
) -> FloatArray:
    """Find where falling functions take the wanted value, between (N,) brackets: the Illinois method on log(factor)."""
    # Rounding may put a root that coincides with its bracket just outside.
    low, high = np.log(low) - 1e-6, np.log(high) + 1e-6
    at_low, at_high = (log_probability(np.exp(end)) - wanted for end in (low, high))
    middle, was_below = low, None
    for _ in range(100):
        middle = high - at_high * (high - low) / (at_high - at_low)
        at_middle = log_probability(np.exp(middle)) - wanted
        if np.all(np.abs(at_middle) < LOG_TOLERANCE):
            break
        below = at_middle > 0
        # An end that stays for a second time is given half its weight, lest it stays for ever.
        stays = np.zeros(len(low), dtype=bool) if was_below is None else below == was_below
        at_low, at_high = (
            np.where(stays & ~below, 0.5 * at_low, at_low),
            np.where(stays & below, 0.5 * at_high, at_high),
        )
        low, at_low = np.where(below, middle, low), np.where(below, at_middle, at_low)
        high, at_high = np.where(below, high, middle), np.where(below, at_high, at_middle)
        was_below = below
    return np.exp(middle)
