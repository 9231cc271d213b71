"""Curves over the frame gap: means over seeds at each gap, and one figure a filter chain where there are many lines."""

import numpy as np
import pytest

from asfm.study.report.gap_curves import MAX_LINES, draw_gaps
from asfm.study.report.statistics import seed_interval
from asfm.study.results_table import GAPS, gap_column
from tests.study.report.rows import make_row, make_rows

REAL = [row for row in make_rows() if row["wrong_share"] is None]


def test_lines_go_through_the_means_over_seeds_and_bands_are_their_intervals() -> None:
    rows = [{**row, "precision_gap_4": row["precision_gap_4"] + 0.004 * row["seed"]} for row in REAL]
    (figure,) = draw_gaps(rows)
    assert figure.name == "gaps" and "n: 36 cells, 3 sequences, 3 seeds." in figure.text
    axes = figure.drawing.axes
    assert [axis.get_ylabel() for axis in axes] == ["precision", "range (bins)", "bearing (beams)"]
    for axis, name in zip(axes, ("precision", "range_noise_bins", "bearing_noise_beams"), strict=True):
        lines = {line.get_label(): line for line in axis.lines}
        assert list(lines) == ["akaze", "orb"]
        np.testing.assert_allclose(lines["orb"].get_xdata(), GAPS)
        own = [row for row in rows if row["detector"] == "orb"]
        found = [seed_interval(own, gap_column(name, gap)) for gap in GAPS]
        np.testing.assert_allclose(lines["orb"].get_ydata(), [one.mean for one in found if one is not None])
        low, high = axis.get_ylim()
        assert all(low <= value <= high for line in axis.lines for value in line.get_ydata())
    band = axes[0].collections[1].get_paths()[0].vertices
    interval = seed_interval([row for row in rows if row["detector"] == "orb"], "precision_gap_4")
    assert interval is not None and interval.high > interval.low
    at_4 = band[band[:, 0] == 4][:, 1]
    assert (at_4.min(), at_4.max()) == pytest.approx((interval.low, interval.high))


def test_many_lines_are_a_figure_a_filter_chain_in_the_same_colours() -> None:
    detectors = [f"matcher {number}" for number in range(MAX_LINES // 2 + 1)]
    rows = [make_row(detector=name, filters=chain, precision_gap_1=0.9) for chain in "xy" for name in detectors]
    rows = [row for row in rows if (row["detector"], row["filters"]) != (detectors[0], "y")]
    first, second = draw_gaps([*rows, *({**row, "filters": "z"} for row in rows[:1])])[:2]
    assert (first.name, second.name) == ("gaps_1", "gaps_2") and second.title.endswith("filters y")
    colours = [{line.get_label(): line.get_color() for line in one.drawing.axes[0].lines} for one in (first, second)]
    assert list(colours[0]) == detectors and list(colours[1]) == detectors[1:]
    assert all(colours[0][name] == colour for name, colour in colours[1].items())


def test_without_elevations_the_share_on_the_arc_is_drawn() -> None:
    (figure,) = draw_gaps([make_row(arc_inlier_ratio_gap_1=0.8, arc_inlier_ratio_gap_2=0.7)])
    (axis,) = figure.drawing.axes
    assert axis.get_ylabel() == "share on the arc" and axis.lines[0].get_xdata().tolist() == [1, 2]
    assert "elevation arc" in figure.text and "true elevations" not in figure.text
    both = draw_gaps([make_row(arc_inlier_ratio_gap_1=0.8, precision_gap_1=0.7)])[0]
    assert [axis.get_ylabel() for axis in both.drawing.axes] == ["precision"]


def test_nothing_is_drawn_of_nothing() -> None:
    assert draw_gaps([make_row(precision=0.5)]) == [] == draw_gaps([])
