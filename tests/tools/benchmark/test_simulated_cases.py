"""Simulated cases: unique names, and paths at several speeds."""

from dataclasses import replace

import numpy as np

from tools.benchmark.simulated_cases import SPEED_FACTORS, Case, _speed_up, list_narrow_cases


def test_cases_differ_by_name_and_narrow_ones_by_speed() -> None:
    """A fast path passes the positions of the usual one earlier, up to an offset of the whole path."""
    usual = Case("seafloor", "didson", 1, 13, "transect")
    narrow = list_narrow_cases(2, 13)
    others = [usual, replace(usual, seed=2), replace(usual, frames=8), replace(usual, motion="")]
    assert len({case.name for case in (*narrow, *others)}) == 2 * len(SPEED_FACTORS) + 4
    slow_m = _speed_up(usual).world_from_vehicle[:, :3, 3]
    for case in narrow[1::2]:
        fast_m = _speed_up(case).world_from_vehicle[:, :3, 3]
        np.testing.assert_allclose(fast_m[1] - fast_m[0], slow_m[int(case.speed_factor)] - slow_m[0], atol=1e-6)
