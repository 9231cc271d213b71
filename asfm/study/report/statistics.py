"""Statistics of a study's figures: means and confidence intervals over seeds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from asfm.study.results_table import Row

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Interval:
    """Mean over seeds with its confidence interval, which is the mean alone for a single seed."""

    mean: float
    low: float
    high: float


def seed_interval(rows: Sequence[Row], name: str, geometric: bool = False) -> Interval | None:
    """Return the mean of a column over seeds, and the interval that Student's t gives for it.

    A seed's value is the mean over all of its cells, so that sequences count alike and do not widen the interval.

    Args:
        rows: cells of one setting; those without a value are left out.
        name: of the column.
        geometric: of its logarithms, for ratios; values that are not positive are left out.

    Returns:
        The interval; None where no cell has a value.
    """
    by_seed: dict[int, list[float]] = {}
    for row in rows:
        if row[name] is not None and (not geometric or row[name] > 0):
            by_seed.setdefault(row["seed"], []).append(float(np.log(row[name]) if geometric else row[name]))
    if not by_seed:
        return None
    values = np.array([np.mean(found) for found in by_seed.values()])
    half = 0.0
    if len(values) > 1:
        from scipy.stats import t

        half = float(t.ppf(0.5 + CONFIDENCE / 2, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values)))
    ends = (values.mean(), values.mean() - half, values.mean() + half)
    return Interval(*(float(np.exp(end)) if geometric else float(end) for end in ends))


def describe_sample(rows: Sequence[Row]) -> str:
    """Return the numbers of cells, sequences and seeds that a figure is made from, as a sentence."""
    sequences, seeds = (len({row[name] for row in rows}) for name in ("sequence", "seed"))
    counts = ((len(rows), "cell"), (sequences, "sequence"), (seeds, "seed"))
    named = (f"{number} {name}" if number == 1 else f"{number} {name}s" for number, name in counts)
    return f"n: {', '.join(named)}."
