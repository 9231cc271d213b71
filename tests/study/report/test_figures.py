"""Figures of a study: what is drawn is what was measured, and what was not measured is not drawn."""

import numpy as np
import pytest

from asfm.study.report.error_law import fit_law
from asfm.study.report.figures import draw_figures
from tests.study.report.rows import make_row, make_rows


def test_all_figures_of_a_full_study_are_drawn() -> None:
    rows = make_rows()
    figures = {figure.name: figure for figure in draw_figures(rows, fit_law(rows))}
    assert list(figures) == [
        "precision_against_ate",
        "matchers",
        "gaps",
        "dial_wrong_share",
        "dial_stated_recall",
        "law",
    ]
    for figure in figures.values():
        assert len(figure.text) > 100 and figure.title
    axis = figures["precision_against_ate"].drawing.axes[0]
    drawn = np.concatenate([points.get_offsets() for points in axis.collections])
    assert len(drawn) == len(rows), "one point a cell"
    expected = sorted((row["precision"], row["ate_over_bound"]) for row in rows)
    np.testing.assert_allclose(sorted(map(tuple, drawn.tolist())), expected)
    colours = {tuple(points.get_facecolor()[0][:3]) for points in axis.collections}
    assert len(colours) == 3, "a colour a matcher"


def test_matchers_stay_in_the_order_of_the_grid_and_every_mode_is_named() -> None:
    rows = [make_row(detector=name, mode=mode, ate_over_bound=1.0) for name in "abc" for mode in ("sonar", "all")]
    rows[0] |= {"ate_over_bound": None, "error": "failed"}
    axis = {figure.name: figure for figure in draw_figures(rows, None)}["matchers"].drawing.axes[0]
    assert [text.get_text() for text in axis.get_yticklabels()] == ["a all", "b all", "c all"]
    assert sorted(axis.get_legend_handles_labels()[1]) == ["all sensors", "sonar alone"]


def test_the_law_is_drawn_over_what_was_measured() -> None:
    law = fit_law(make_rows())
    assert law is not None
    figure = next(figure for figure in draw_figures(make_rows(), law) if figure.name == "law")
    drawn = np.concatenate([points.get_offsets() for points in figure.drawing.axes[0].collections[:2]])
    measured = np.exp([setting.log_ratio for setting in law.settings])
    np.testing.assert_allclose(sorted(drawn[:, 0]), sorted(measured))
    np.testing.assert_allclose(sorted(drawn[:, 1]), sorted(np.exp(law.predicted)))
    assert "within" in figure.text and "predicts from the other scenes" in figure.text


@pytest.mark.parametrize(
    ("values", "label", "quality"),
    [
        (
            {"ate_over_odometry": 0.5, "arc_inlier_ratio": 0.9},
            "ATE / ATE of the odometry",
            "share on the elevation arc",
        ),
        ({"ate_over_path_percent": 2.0, "precision": 0.9}, "ATE / path (%)", "precision of the matches"),
    ],
)
def test_sequences_without_a_bound_are_compared_by_what_they_have(
    values: dict[str, float], label: str, quality: str
) -> None:
    rows = [make_row(**values), make_row(detector="orb", **values)]
    first, second = draw_figures(rows, None)
    assert first.drawing.axes[0].get_ylabel() == label == second.drawing.axes[0].get_xlabel()
    assert first.drawing.axes[0].get_xlabel() == quality


def test_nothing_is_drawn_of_nothing() -> None:
    assert draw_figures([make_row(error="failed")], None) == []
    assert draw_figures([], None) == []
