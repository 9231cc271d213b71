"""Curves over a dial: means and bands over seeds, at the first values of the other dials."""

import numpy as np
import pytest

from asfm.study.report.dial_curves import draw_dial, draw_other_kind
from asfm.study.report.statistics import seed_interval
from tests.study.report.rows import make_rows

ROWS = make_rows()
CORRUPTED = [row for row in ROWS if row["wrong_share"] is not None]
REAL = [row for row in ROWS if row["wrong_share"] is None]


def test_a_curve_goes_through_the_means_of_its_mode() -> None:
    figure = draw_dial(CORRUPTED, REAL, "wrong_share")
    assert figure is not None and figure.name == "dial_wrong_share"
    for axis, column in zip(figure.drawing.axes, ("ate_m", "ate_over_bound"), strict=True):
        curves = {line.get_label(): line for line in axis.lines}
        assert set(curves) == {"sonar alone", "all sensors"}
        np.testing.assert_allclose(curves["all sensors"].get_xdata(), [0, 0.1, 0.3])
        for share, height in zip((0.0, 0.1, 0.3), curves["all sensors"].get_ydata(), strict=True):
            own = [row for row in CORRUPTED if row["mode"] == "all" and row["stated_recall"] == 1.0]
            expected = seed_interval([row for row in own if row["wrong_share"] == share], column)
            assert expected is not None and height == pytest.approx(expected.mean)
        points = [tuple(np.round(item.get_offsets()[0], 6)) for item in axis.collections if item.get_offsets().any()]
        assert len(points) == 4, "two matchers in two modes"
        assert {round(x, 2) for x, _ in points} == {0.05, 0.15}, "at one minus their precision"
    assert "recall 1.0" in figure.text and "Points are real matchers" in figure.text


def test_values_that_are_no_numbers_are_drawn_side_by_side() -> None:
    rows = [{**row, "stated_track_length": length} for row in CORRUPTED for length in (None, 6)]
    figure = draw_dial(rows, [], "stated_track_length")
    assert figure is not None
    axis = figure.drawing.axes[1]
    assert [text.get_text() for text in axis.get_xticklabels()] == ["no limit", "6"]
    np.testing.assert_allclose(axis.lines[0].get_xdata(), [0, 1])


def test_a_dial_with_one_value_has_no_curve() -> None:
    assert draw_dial(CORRUPTED, REAL, "noise_kind") is None
    assert draw_dial([], REAL, "wrong_share") is None


def test_every_kind_of_wrong_matches_has_its_curve_from_none() -> None:
    alike = [{**row, "wrong_kind": "look-alike", "ate_m": 1.0} for row in CORRUPTED if row["wrong_share"]]
    figure = draw_other_kind([*CORRUPTED, *alike], [], "look-alike")
    assert figure is not None and figure.name == "dial_wrong_share_look_alike"
    line = figure.drawing.axes[0].lines[0]
    np.testing.assert_allclose(line.get_xdata(), [0, 0.1, 0.3])
    np.testing.assert_allclose(line.get_ydata()[1:], 1.0)
    assert line.get_ydata()[0] < 0.1
