"""Runs of mistakes: what is compared with what, and when a cell is wrong without a word."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from tests.worlds import make_vehicle_sequence
from tools.benchmark import mistake_runs
from tools.benchmark.mistake_runs import Cell, Outcome, compare_mistakes, list_mistake_numbers, tabulate_cells
from tools.benchmark.mistakes import MISTAKES, Mistake

RIGHT = Outcome(0.02, frozenset({"unobserved-directions"}))


def cell(ate_m: float, *codes: str) -> Cell:
    return Cell("range window +20 %", "odometry", Outcome(ate_m, frozenset(codes)), RIGHT, 0.08)


@pytest.mark.parametrize(
    ("found", "silent"),
    [
        (cell(0.11), False),
        (cell(0.13), True),
        (cell(0.13, "unobserved-directions"), True),
        (cell(0.13, "calibration-inconsistent"), False),
        (cell(np.inf, "refused"), False),
    ],
)
def test_a_cell_is_silent_where_nothing_new_is_said_of_a_worse_result(found: Cell, silent: bool) -> None:
    assert found.silent_and_wrong is silent
    numbers = list_mistake_numbers([found])
    assert numbers[1].reached == silent
    assert any("SILENT" in line for line in tabulate_cells("seafloor", [found])) is silent


def test_mistakes_are_made_where_their_sensor_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    """The reference is the run of the sensors that are right, or the odometry where the images are wrong."""
    rights = {"all sensors": 0.02, "odometry": 0.04, "depth and attitude": 0.06, "sonar alone": 0.2}

    def measure(_: Any, mode: str) -> Outcome:
        return Outcome(rights[mode], frozenset())

    monkeypatch.setattr(mistake_runs, "measure", measure)
    mistakes = (
        Mistake("wrong odometry", "odometry", partial(replace_nothing)),
        Mistake("wrong depth", "navigation", partial(replace_nothing)),
        Mistake("wrong order", "images", partial(replace_nothing)),
        Mistake("wrong range", "images", partial(replace_nothing), about_geometry=True),
    )
    sequence = make_vehicle_sequence()
    found = {(item.mistake, item.mode): item for item in compare_mistakes(sequence, tuple(rights), mistakes)}
    assert {mode for name, mode in found if name == "wrong odometry"} == {"all sensors", "odometry"}
    assert {mode for name, mode in found if name == "wrong depth"} == {"all sensors", "depth and attitude"}
    assert {mode for name, mode in found if name == "wrong order"} == set(rights)
    assert {mode for name, mode in found if name == "wrong range"} == set(rights) - {"sonar alone"}
    assert found["wrong odometry", "all sensors"].reference_ate_m == rights["depth and attitude"]
    assert found["wrong odometry", "odometry"].reference_ate_m == rights["sonar alone"]
    assert found["wrong depth", "all sensors"].reference_ate_m == rights["odometry"]
    assert 0 < found["wrong range", "odometry"].reference_ate_m < 1, "the odometry's own error"
    assert found["wrong order", "sonar alone"].reference_ate_m == 0


def test_images_are_read_once() -> None:
    read: list[int] = []
    frame: Any = object()

    def read_frame(index: int) -> Any:
        read.append(index)
        return frame

    sequence = replace(make_vehicle_sequence(), read_frame=read_frame)
    held = mistake_runs.hold_images(sequence)
    assert held.read_frame(3) is frame and held.read_frame(3) is frame and sorted(read) == list(range(len(sequence)))


def replace_nothing(sequence: Any) -> Any:
    return sequence


def test_refused_inputs_are_not_silent() -> None:
    (odometry,) = (mistake for mistake in MISTAKES if mistake.name == "odometry in mm")
    sequence = odometry.apply(make_vehicle_sequence())
    assert sequence.odometry is not None and np.ptp(sequence.odometry.world_from_vehicle[:, 0, 3]) > 1000
