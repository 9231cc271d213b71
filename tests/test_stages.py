"""The stopwatch of the stages: order, counts, time and memory."""

import time

import pytest

from asfm.stages import StageClock, peak_memory_mb


def test_stages_are_reported_in_order_with_time_memory_and_counts() -> None:
    clock = StageClock()
    with clock.stage("first") as report:
        time.sleep(0.02)
        report.counts["frames"] = 3
    with clock.stage("second"):
        pass
    first, second = clock.reports
    assert (first.name, first.counts, second.name, second.counts) == ("first", {"frames": 3}, "second", {})
    assert first.wall_s >= 0.02 > second.wall_s
    assert 0 < first.peak_memory_mb <= second.peak_memory_mb <= peak_memory_mb()


def test_stage_that_fails_is_not_reported() -> None:
    clock = StageClock()
    with pytest.raises(RuntimeError), clock.stage("failing"):
        raise RuntimeError
    assert clock.reports == []
