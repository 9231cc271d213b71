"""Plot of precision against ATE: what is drawn, the same bytes each time, and names that could mislead Matplotlib."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import cv2
import numpy as np
import pytest

from asfm.evaluation.precision_plot import MAX_NAMED, draw_precision, plottable
from asfm.evaluation.run_comparison import ComparedRun, RunLabels

RUN = ComparedRun(RunLabels("first", "reef", "akaze, mutual"), 1.0, precision=0.9, ate_m=0.05)
OTHER = replace(RUN, labels=RunLabels("second", "reef", "orb, mutual"), precision=0.97, ate_m=0.02)
TANK = ComparedRun(
    RunLabels("third", "tank", "akaze, mutual"), 1.0, arc_inlier_ratio=0.8, ate_m=0.3, mirror_ambiguous=True
)


def test_runs_without_error_or_share_are_not_plotted() -> None:
    assert plottable([RUN, replace(RUN, ate_m=None), replace(RUN, precision=None), TANK]) == [RUN, TANK]


def test_both_pictures_are_whole_and_the_same_each_time() -> None:
    pictures = draw_precision([RUN, OTHER, TANK])
    assert pictures == draw_precision([RUN, OTHER, TANK])
    assert ElementTree.fromstring(pictures["svg"]).tag.endswith("svg")
    image = cv2.imdecode(np.frombuffer(pictures["png"], np.uint8), cv2.IMREAD_COLOR)
    assert image is not None and image.shape == (750, 1200, 3)
    blue, orange = (int((np.abs(image.astype(int) - colour).max(axis=2) < 12).sum()) for colour in BGR)
    assert blue > 500 and orange > 500, "each matcher has its colour"
    assert pictures != draw_precision([RUN, OTHER])


BGR = (np.array([0xB2, 0x72, 0x00]), np.array([0x00, 0x5E, 0xD5]))
"""The first two colours."""


def test_a_hollow_marker_has_less_ink_than_a_full_one() -> None:
    def ink(run: ComparedRun) -> int:
        png = draw_precision([run])["png"]
        image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        return int((np.abs(image[90:600].astype(int) - BGR[0]).max(axis=2) < 40).sum())

    hollow = replace(RUN, precision=None, arc_inlier_ratio=0.9)
    assert 0 < ink(hollow) < 0.7 * ink(RUN)


def test_a_better_precision_lies_to_the_right_and_a_smaller_error_below() -> None:
    png = draw_precision([RUN, OTHER])["png"]
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    centres = []
    for colour in BGR:
        row, column = np.nonzero(np.abs(image[100:].astype(int) - colour).max(axis=2) < 12)
        centres.append((row.mean(), column.mean()))
    (first_row, first_column), (other_row, other_column) = centres
    assert other_column > first_column and other_row > first_row


@pytest.mark.parametrize("name", ["$x_{", "_hidden", "a\\b", "<&>"])
def test_any_name_is_drawn(name: str) -> None:
    odd = replace(RUN, labels=RunLabels(name, name, name))
    assert ElementTree.fromstring(draw_precision([odd])["svg"]).tag.endswith("svg")


@pytest.mark.parametrize("errors_m", [(0.0, 0.0), (1e-9, 5.0), (0.1, 0.1)])
def test_any_errors_are_drawn(errors_m: tuple[float, float]) -> None:
    runs = [replace(RUN, ate_m=error_m, precision=1.0) for error_m in errors_m]
    assert draw_precision(runs)["png"]


def test_many_runs_are_not_named() -> None:
    many = [replace(RUN, labels=replace(RUN.labels, run=f"run {n}"), precision=n / 40) for n in range(MAX_NAMED + 1)]
    few, all_of_them = (len(draw_precision(runs)["svg"]) for runs in (many[:-1], many))
    assert all_of_them < few
