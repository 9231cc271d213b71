"""Hover titles of points in SVG figures: the values of a cell, shown by the browser without any script."""

import html
import json
import re
from base64 import urlsafe_b64decode, urlsafe_b64encode
from collections.abc import Sequence
from typing import Any

from asfm.study.report.figure_style import MODES
from asfm.study.results_table import Row

PREFIX = "titles:"
GROUP = re.compile(rf'<g id="{PREFIX}([\w=-]*)">(.*?)</g>\s*</g>', re.DOTALL)
"""A group of points: matplotlib writes one element "use" a point, in a group that clips them."""
POINT = re.compile(r"<use ([^>]*)/>")
VALUES = {
    "precision": "precision",
    "arc_inlier_ratio": "arc inliers",
    "recall": "recall",
    "ate_m": "ATE (m)",
    "ate_over_odometry": "ATE / odometry",
    "ate_over_bound": "ATE / bound",
}


def title_points(artist: Any, titles: Sequence[str]) -> None:
    """Give the points of a scatter or a line with markers their titles, one a point, in the identifier of its group."""
    artist.set_gid(PREFIX + urlsafe_b64encode(json.dumps(list(titles)).encode()).decode())


def insert_titles(svg: str) -> str:
    """Turn identifiers made by :func:`title_points` into an element "title" a point.

    Where points and titles differ in number, as where matplotlib leaves out points beyond the canvas, there are none.
    """
    return GROUP.sub(_insert, svg)


def _insert(group: re.Match[str]) -> str:
    titles, points = json.loads(urlsafe_b64decode(group[1])), group[2]
    if len(POINT.findall(points)) == len(titles):
        left = iter(titles)
        points = POINT.sub(lambda point: f"<use {point[1]}><title>{html.escape(next(left))}</title></use>", points)
    return f"<g>{points}</g></g>"


def describe_cell(row: Row) -> str:
    """Return what a cell is and what was measured, a line each."""
    dials = "" if row["wrong_share"] is None else f" {row['wrong_share']:g} wrong, recall {row['stated_recall']:g}"
    names = f"{row['detector']} {row['filters']}{dials}"
    values = [f"{name} {row[column]:.3g}" for column, name in VALUES.items() if row[column] is not None]
    return "\n".join([names, f"{row['sequence']}, {MODES[row['mode']]}, seed {row['seed']}", *values])
