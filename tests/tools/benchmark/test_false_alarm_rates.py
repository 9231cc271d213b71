"""False-alarm rates of CFAR on simulated noise."""

import pytest

from tools.benchmark.false_alarm_rates import _rate, _simulate_noise


def test_rates_on_rayleigh_noise_are_the_design_rates() -> None:
    speckle = _simulate_noise("rayleigh", 0)
    line = next(iter(list(_rate("noise", [speckle], slice(None), ("rayleigh",), ("ca",)))[1:]))
    assert [float(ratio) for ratio in line.split()[-3:-1]] == pytest.approx([1.0, 1.0], rel=0.1)
