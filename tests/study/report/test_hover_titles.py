"""Hover titles: one a point, in its order, with the values of its cell."""

import re
from xml.etree import ElementTree

from asfm.study.report.figure_style import Figure, make_axes
from asfm.study.report.hover_titles import describe_cell, insert_titles, title_points
from asfm.study.report.html_report import render
from tests.study.report.rows import make_row

TITLE = "{http://www.w3.org/2000/svg}use/{http://www.w3.org/2000/svg}title"


def test_every_point_of_scatters_and_lines_has_its_title() -> None:
    drawing, (axis,) = make_axes(2.0)
    title_points(axis.scatter([1, 2, 3], [3, 1, 2], 16), ['a "<b>" & é', "b", "c"])
    (line,) = axis.plot([1, 2], [1, 2], marker="s")
    title_points(line, ["d", "e"])
    axis.scatter([2], [2])
    text = render(Figure("f", "f", "f", drawing), "svg").decode()
    found = ElementTree.fromstring(text).findall(f".//{TITLE}")
    assert [title.text for title in found] == ['a "<b>" & é', "b", "c", "d", "e"]
    x = {title: float(at) for at, title in re.findall(r'x="([\d.]+)"[^>]*><title>(\w)</title>', text)}
    assert x["d"] < x["b"] < x["c"] and abs(x["b"] - x["e"]) < 1e-3


def test_titles_that_do_not_fit_are_left_out() -> None:
    group = '<g id="titles:WyJhIl0="><g clip-path="url(#p)"><use x="1"/><use x="2"/></g></g>'
    assert insert_titles(group) == '<g><g clip-path="url(#p)"><use x="1"/><use x="2"/></g></g>'
    assert insert_titles("<svg/>") == "<svg/>"


def test_a_cell_is_described_by_what_was_measured() -> None:
    row = make_row(precision=0.91234, ate_m=0.0123456, mode="sonar", seed=3)
    assert describe_cell(row) == "akaze all\npier-sonar, sonar alone, seed 3\nprecision 0.912\nATE (m) 0.0123"
    corrupted = make_row(detector="true matches", filters="none", wrong_share=0.4, stated_recall=0.5)
    assert describe_cell(corrupted).startswith("true matches none 0.4 wrong, recall 0.5\n")
