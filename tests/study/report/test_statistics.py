"""Intervals over seeds: those of SciPy's t-test, each seed counted once."""

import numpy as np
import pytest
from scipy.stats import ttest_1samp

from asfm.study.report.statistics import seed_interval
from tests.study.report.rows import make_row


@pytest.mark.parametrize("geometric", [False, True])
def test_the_interval_is_that_of_students_t_over_seeds(geometric: bool) -> None:
    values = {0: [0.1, 0.3], 1: [0.5], 2: [0.2, 0.6, 0.4]}
    rows = [make_row(seed=seed, ate_m=value) for seed, found in values.items() for value in found]
    rows += [make_row(seed=9), make_row(seed=8, error="failed")]
    forward, back = (np.log, np.exp) if geometric else (np.asarray, np.asarray)
    means = [np.mean(forward(np.array(found))) for found in values.values()]
    expected = ttest_1samp(means, 0).confidence_interval(0.95)
    found = seed_interval(rows, "ate_m", geometric)
    assert found is not None
    assert (found.low, found.high) == pytest.approx((float(back(expected.low)), float(back(expected.high))))
    assert found.mean == pytest.approx(float(back(np.mean(means))))


def test_one_seed_has_no_width_and_none_no_interval() -> None:
    found = seed_interval([make_row(ate_m=0.1), make_row(ate_m=0.3)], "ate_m")
    assert found is not None and found.low == found.mean == found.high == pytest.approx(0.2)
    assert seed_interval([make_row()], "ate_m") is None
