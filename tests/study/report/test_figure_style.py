"""Style of figures: plain numbers on logarithmic axes, few of them where they span decades."""

import pytest

from asfm.study.report.figure_style import COLOURS, add_legend_of_colours, colour_of, make_axes, use_log_scale


@pytest.mark.parametrize(
    ("high", "expected"), [(9.0, ["0.5", "1", "2", "5", "10"]), (900.0, ["1", "10", "100", "1000"])]
)
def test_logarithmic_axes_have_plain_numbers(high: float, expected: list[str]) -> None:
    drawing, (axis,) = make_axes(3.0)
    axis.plot([0, 1], [0.4, high])
    use_log_scale(axis, "error")
    drawing.draw_without_rendering()
    low, top = axis.get_ylim()
    ticks = zip(axis.get_yticklabels(), axis.get_yticks(), strict=True)
    shown = [text.get_text() for text, at in ticks if low <= at <= top]
    assert shown == expected and axis.get_ylabel() == "error"


def test_colours_begin_again_and_a_legend_names_them() -> None:
    assert colour_of(len(COLOURS)) == colour_of(0) != colour_of(1)
    drawing, (axis,) = make_axes(3.0)
    add_legend_of_colours(drawing, axis, {"one": "#ff0000", "two": "#00ff00"})
    assert [text.get_text() for text in drawing.legends[0].get_texts()] == ["one", "two"]
